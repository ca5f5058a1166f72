"""The cache gives the same scans as their source, makes nothing twice, and refuses damaged files."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.network_image import make_image
from offradar_ros.errors import DataError
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.drives.range_reduction import Reduction
from offradar_ros.lab.training.config import DataConfig
from offradar_ros.lab.training.simulated_drives import city_drive
from offradar_ros.radar.spinning import spin
from offradar_ros.types import PolarScan

NETWORK = NetworkConfig(backbone='vgg16', side_px=96, resolution_m=0.5)
POLAR = NetworkConfig(backbone='compact', azimuths=40, range_bins=64, resolution_m=0.5)
REDUCTION = Reduction.for_image(NETWORK)


@dataclasses.dataclass(frozen=True)
class NoiseDrive:
    """Every second of some scans of noise of any layout; some are damaged."""

    count: int = 8
    bins: int = 400
    resolution_m: float = 0.1736
    damaged: tuple[int, ...] = ()
    first_azimuth: int = 0
    name: str = 'noise'
    world: str = 'w'

    def settings(self) -> dict[str, Any]:
        return dataclasses.asdict(self)

    def scan(self, index: int) -> PolarScan:
        if index in self.damaged:
            raise DataError(f'scan {index} is damaged')
        power = np.random.default_rng(index).integers(0, 255, (60, self.bins), np.uint8)
        azimuths = np.asarray((np.arange(60) + self.first_azimuth) % 60 * (2 * np.pi / 60), np.float64)
        return PolarScan(index, power, azimuths, self.resolution_m, 0.3)

    def open(self) -> Drive:
        indices = np.arange(0, self.count, 2)
        kinds = np.array(['flooded' if index == 4 else '' for index in indices])
        return Drive(
            name=self.name,
            world=self.world,
            key=self.name,
            stamps_ns=indices.astype(np.int64),
            poses=np.column_stack([indices, indices, indices]).astype(np.float64),
            driven_m=indices.astype(np.float64),
            kinds=kinds,
            severities=(kinds != '').astype(np.float64),
            read_scan=lambda row: self.scan(int(indices[row])),
            layout='noise',
        )


def cached(folder: Path, *sources: NoiseDrive, **options: Any) -> list[Drive]:
    return cached_drives(sources, folder, **{'reduction': REDUCTION, **options})


@pytest.mark.parametrize('resolution_m', [0.0432, 0.0596, 0.1736, 0.25, 0.4])
def test_images_of_cached_scans_are_those_of_the_scans(tmp_path: Path, resolution_m: float) -> None:
    source = NoiseDrive(bins=round(50.0 / resolution_m), resolution_m=resolution_m)
    (drive,) = cached(tmp_path, source)
    assert drive.scan(0).range_resolution_m <= 0.25 or resolution_m > 0.25
    for row in range(4):
        scan = source.scan(2 * row)
        for turn in (0, 1, 25):
            expected = make_image(NETWORK)(spin(scan, turn))
            assert np.array_equal(make_image(NETWORK)(spin(drive.scan(row), turn)), expected)


def test_polar_images_of_cached_scans_are_near_those_of_the_scans(tmp_path: Path) -> None:
    """Eight bins are averaged to one: the range limits of the image and every byte are rounded."""
    source = NoiseDrive(bins=1600, resolution_m=0.03)
    (drive,) = cached(tmp_path, source, reduction=Reduction.for_image(POLAR))
    image, direct = make_image(POLAR)(spin(drive.scan(1), 9)), make_image(POLAR)(spin(source.scan(2), 9))
    difference = np.abs(image.astype(int) - direct)
    assert drive.scan(0).range_resolution_m == 0.24
    assert difference.mean() < 0.15 * direct.std()


def test_without_a_reduction_power_does_not_change(tmp_path: Path) -> None:
    source = NoiseDrive()
    (drive,) = cached(tmp_path, source, reduction=None)
    (reduced,) = cached(tmp_path, source)
    for row in range(4):
        scan, kept = source.scan(2 * row), drive.scan(row)
        np.testing.assert_array_equal(kept.power, scan.power)
        assert (kept.stamp_ns, kept.range_resolution_m, kept.range_offset_m) == (2 * row, 0.1736, 0.3)
    assert drive.key != reduced.key
    assert reduced.scan(0).power.shape[1] < 400


def test_scans_with_another_first_azimuth_are_sorted(tmp_path: Path) -> None:
    source = NoiseDrive(first_azimuth=7)
    (drive,) = cached(tmp_path, source)
    assert (np.diff(drive.scan(0).azimuths_rad) > 0.0).all()
    assert np.array_equal(make_image(NETWORK)(drive.scan(1)), make_image(NETWORK)(source.scan(2)))


def test_a_cached_drive_has_poses_and_faults_but_no_damaged_scans(tmp_path: Path) -> None:
    (drive,) = cached(tmp_path, NoiseDrive(damaged=(2,)))
    assert len(drive) == 3
    assert (drive.name, drive.world, drive.layout) == ('noise', 'w', 'noise')
    assert drive.poses[:, 0].tolist() == drive.driven_m.tolist() == drive.stamps_ns.tolist() == [0, 4, 6]
    assert drive.kinds.tolist() == ['', 'flooded', '']
    assert drive.severities.tolist() == [0.0, 1.0, 0.0]
    known = json.loads(next(tmp_path.glob('*.json')).read_text())
    assert known['left_out'] == 1
    assert len(list(tmp_path.iterdir())) == 2


def test_a_drive_without_a_readable_scan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match='noise: none of its scans can be read'):
        cached(tmp_path, NoiseDrive(damaged=(0, 2, 4, 6)))


def test_a_drive_is_made_once_for_each_setting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[int, int]] = []

    def note(done: int, total: int) -> None:
        made.append((done, total))

    cached(tmp_path, NoiseDrive(), progress=note)
    assert made == [(1, 1)]
    cached(tmp_path, NoiseDrive(), NoiseDrive(count=6), processes=1, progress=note)
    cached(tmp_path, NoiseDrive(), reduction=Reduction(0.25, 20.0), progress=note)
    assert made == [(1, 1)] * 3
    monkeypatch.setattr(NoiseDrive, 'open', lambda self: pytest.fail('made again'))
    assert len(cached(tmp_path, NoiseDrive(), NoiseDrive(count=6), NoiseDrive())) == 3


def test_an_unfinished_drive_is_made_again(tmp_path: Path) -> None:
    (before,) = cached(tmp_path, NoiseDrive())
    power = [before.scan(row).power for row in range(4)]
    next(tmp_path.glob('*.json')).unlink()
    next(tmp_path.glob('noise-*.npy')).write_bytes(b'cut off')
    (tmp_path / '999999999.abc.partial').mkdir()
    (after,) = cached(tmp_path, NoiseDrive())
    assert all(np.array_equal(after.scan(row).power, power[row]) for row in range(4))
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(('pattern', 'content'), [('*.json', b'{}'), ('*.json', b'no json'), ('*.npy', b'cut')])
def test_damaged_files_are_reported(tmp_path: Path, pattern: str, content: bytes) -> None:
    cached(tmp_path, NoiseDrive())
    next(tmp_path.glob(pattern)).write_bytes(content)
    with pytest.raises(DataError, match=r'noise-\w+\.json: .*remove it to make it again'):
        cached(tmp_path, NoiseDrive())


@pytest.mark.parametrize('key', ['poses', 'severities', 'stamps_ns'])
def test_files_that_do_not_belong_together_are_reported(tmp_path: Path, key: str) -> None:
    cached(tmp_path, NoiseDrive())
    file = next(tmp_path.glob('*.json'))
    known = json.loads(file.read_text())
    file.write_text(json.dumps({**known, key: [*known[key], known[key][0]]}))
    with pytest.raises(DataError, match='its files do not belong together'):
        cached(tmp_path, NoiseDrive())


def test_a_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(DataError, match='file: the cache cannot be written'):
        cached(tmp_path / 'file', NoiseDrive())


def test_several_processes_make_the_same_drives_as_one(tmp_path: Path) -> None:
    config = DataConfig(scans=3, spacing_m=30.0, degraded=0.5, bad_weather=0.5)
    sources = [city_drive(5, index, config) for index in range(2)]
    alone = cached_drives(sources, tmp_path / 'alone', reduction=REDUCTION, processes=1)
    together = cached_drives(sources, tmp_path / 'together', reduction=REDUCTION, processes=2)
    for a, b in zip(alone, together, strict=True):
        assert all(np.array_equal(a.scan(row).power, b.scan(row).power) for row in range(3))
        assert np.array_equal(a.poses, b.poses)
        assert a.kinds.tolist() == b.kinds.tolist()
