"""The cache holds what direct conversion gives, makes nothing twice, and does not believe what it did not write."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.network_image import make_image
from offradar_ros.errors import DataError
from offradar_ros.geometry import Trajectory
from offradar_ros.lab.training.cache import Reduction, cached_drives
from offradar_ros.lab.training.drive import OpenDrive
from offradar_ros.lab.training.recorded_drives import recorded_drives
from offradar_ros.lab.training.simulated_drives import SimulatedDrive
from offradar_ros.radar.spinning import spin
from offradar_ros.types import PolarScan

NETWORK = NetworkConfig(backbone='vgg16', side_px=96, resolution_m=0.5)
POLAR = NetworkConfig(backbone='compact', azimuths=40, range_bins=64, resolution_m=0.5)
REDUCTION = Reduction.for_image(NETWORK)


@dataclasses.dataclass(frozen=True)
class NoiseSequence:
    """Scans of noise of any layout; some are damaged."""

    count: int
    bins: int
    resolution_m: float
    damaged: tuple[int, ...]
    first_azimuth: int
    name: str = 'noise'
    layout: str = 'test'
    trajectory: Trajectory | None = None

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        return np.arange(self.count, dtype=np.int64)

    def __len__(self) -> int:
        return self.count

    def scan(self, index: int) -> PolarScan:
        if index in self.damaged:
            raise DataError(f'scan {index} is damaged')
        power = np.random.default_rng(index).integers(0, 255, (60, self.bins), np.uint8)
        azimuths = (np.arange(60) + self.first_azimuth) % 60 * (2 * np.pi / 60)
        return PolarScan(index, power, azimuths, self.resolution_m, 0.3)


@dataclasses.dataclass(frozen=True)
class NoiseDrive:
    """As training sees such a sequence: every second scan of it."""

    count: int = 8
    bins: int = 400
    resolution_m: float = 0.1736
    damaged: tuple[int, ...] = ()
    first_azimuth: int = 0
    name: str = 'noise'
    world: str = 'w'

    def open(self) -> OpenDrive:
        indices = np.arange(0, self.count, 2)
        kinds = tuple('flooded' if index == 4 else '' for index in indices)
        sequence = NoiseSequence(self.count, self.bins, self.resolution_m, self.damaged, self.first_azimuth)
        poses = np.column_stack([indices, indices, indices]).astype(np.float64)
        return OpenDrive(sequence, indices, poses, kinds, np.array([k != '' for k in kinds], np.float32))


@pytest.mark.parametrize('resolution_m', [0.0432, 0.0596, 0.1736, 0.25, 0.4])
def test_images_of_cached_scans_are_those_of_the_scans(tmp_path: Path, resolution_m: float) -> None:
    drive = NoiseDrive(bins=round(50.0 / resolution_m), resolution_m=resolution_m)
    (cached,) = cached_drives(tmp_path, [drive], REDUCTION)
    assert cached.range_resolution_m <= 0.25 or resolution_m > 0.25
    opened = drive.open()
    for row, index in enumerate(opened.indices.tolist()):
        scan = opened.sequence.scan(index)
        for turn in (0, 1, 25):
            expected = make_image(NETWORK)(spin(scan, turn))
            assert np.array_equal(make_image(NETWORK)(cached.scan(row, turn)), expected)


def test_polar_images_of_cached_scans_are_near_those_of_the_scans(tmp_path: Path) -> None:
    """Eight bins are joined to one: the ends of the image and every byte are rounded to what there is then."""
    drive = NoiseDrive(bins=1600, resolution_m=0.03)
    (cached,) = cached_drives(tmp_path, [drive], Reduction.for_image(POLAR))
    image, direct = make_image(POLAR)(cached.scan(1, 9)), make_image(POLAR)(spin(drive.open().sequence.scan(2), 9))
    away = np.abs(image.astype(int) - direct)
    assert cached.range_resolution_m == 0.24
    assert away.mean() < 0.15 * direct.std()


def test_scans_that_start_elsewhere_are_put_in_the_order_of_their_azimuths(tmp_path: Path) -> None:
    drive = NoiseDrive(first_azimuth=7)
    (cached,) = cached_drives(tmp_path, [drive], REDUCTION)
    assert (np.diff(cached.azimuths_rad) > 0.0).all()
    assert np.array_equal(make_image(NETWORK)(cached.scan(1)), make_image(NETWORK)(drive.open().sequence.scan(2)))


def test_a_drive_brings_its_poses_and_faults_and_loses_damaged_scans(tmp_path: Path) -> None:
    (cached,) = cached_drives(tmp_path, [NoiseDrive(damaged=(2,))], REDUCTION)
    assert len(cached.power) == 3
    assert cached.poses[:, 0].tolist() == [0.0, 4.0, 6.0]
    assert cached.kinds == ('', 'flooded', '')
    assert cached.severities.tolist() == [0.0, 1.0, 0.0]
    said = json.loads(next(tmp_path.glob('*.json')).read_text())
    assert said['left_out'] == 1
    assert not list(tmp_path.glob('.*'))


def test_a_drive_without_a_readable_scan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match='noise: no scan of it can be read'):
        cached_drives(tmp_path, [NoiseDrive(damaged=(0, 2, 4, 6))], REDUCTION)


def test_nothing_is_made_twice_and_other_settings_are_other_drives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[int, int]] = []
    cached_drives(tmp_path, [NoiseDrive()], REDUCTION, progress=lambda *done: told.append(done))
    assert told == [(1, 1)]
    cached_drives(tmp_path, [NoiseDrive(), NoiseDrive(count=6)], REDUCTION, 1, lambda *done: told.append(done))
    cached_drives(tmp_path, [NoiseDrive()], Reduction(0.25, 20.0), progress=lambda *done: told.append(done))
    assert told == [(1, 1)] * 3
    monkeypatch.setattr(NoiseDrive, 'open', lambda self: pytest.fail('made again'))
    assert len(cached_drives(tmp_path, [NoiseDrive(), NoiseDrive(count=6)], REDUCTION)) == 2


def test_what_was_not_finished_is_made_again(tmp_path: Path) -> None:
    (before,) = cached_drives(tmp_path, [NoiseDrive()], REDUCTION)
    power = np.array(before.power)
    next(tmp_path.glob('*.json')).unlink()
    next(p for p in tmp_path.glob('noise-*.npy') if p.name.count('.') == 1).write_bytes(b'cut off')
    (after,) = cached_drives(tmp_path, [NoiseDrive()], REDUCTION)
    assert np.array_equal(after.power, power)


@pytest.mark.parametrize(
    ('pattern', 'content'),
    [('*.json', b'{}'), ('*.json', b'no json'), ('*.severities.npy', b'cut'), ('*.poses.npy', b'')],
)
def test_damaged_files_are_named(tmp_path: Path, pattern: str, content: bytes) -> None:
    cached_drives(tmp_path, [NoiseDrive()], REDUCTION)
    next(tmp_path.glob(pattern)).write_bytes(content)
    with pytest.raises(DataError, match=r'noise-\w+\.json: .*remove it to make it again'):
        cached_drives(tmp_path, [NoiseDrive()], REDUCTION)


def test_files_that_do_not_belong_together_are_named(tmp_path: Path) -> None:
    cached_drives(tmp_path, [NoiseDrive()], REDUCTION)
    np.save(next(tmp_path.glob('*.poses.npy')), np.zeros((2, 3)))
    with pytest.raises(DataError, match='do not belong together'):
        cached_drives(tmp_path, [NoiseDrive()], REDUCTION)


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(DataError, match='file: the cache cannot be written'):
        cached_drives(tmp_path / 'file', [NoiseDrive()], REDUCTION)


def test_processes_make_what_one_makes(tmp_path: Path) -> None:
    drives = [SimulatedDrive(5, index, 3, 30.0, 0.5, 'drawn', 0.5) for index in range(2)]
    alone = cached_drives(tmp_path / 'alone', drives, REDUCTION, workers=1)
    together = cached_drives(tmp_path / 'together', drives, REDUCTION, workers=2)
    for a, b in zip(alone, together, strict=True):
        assert np.array_equal(a.power, b.power)
        assert np.array_equal(a.poses, b.poses)
        assert a.kinds == b.kinds


def test_simulated_drives_of_a_world_meet_in_both_directions() -> None:
    opened = [SimulatedDrive(5, index, 40, 6.0, 0.25, 'drawn', 0.0).open() for index in range(3)]
    assert [len(drive.indices) for drive in opened] == [40] * 3
    spacing_m = np.linalg.norm(np.diff(opened[0].poses[:, :2], axis=0), axis=1)
    assert spacing_m.mean() == pytest.approx(6.0, rel=0.35)
    for other in opened[1:]:
        away_m = np.linalg.norm(opened[0].poses[:, None, :2] - other.poses[None, :, :2], axis=-1).min(axis=1)
        assert (away_m < 15.0).mean() > 0.7
    turn = np.cos(opened[0].poses[20, 2] - opened[1].poses[20, 2])
    assert turn > 0.5
    back = np.linalg.norm(opened[2].poses[:, :2] - opened[0].poses[20, :2], axis=1).argmin()
    assert np.cos(opened[0].poses[20, 2] - opened[2].poses[back, 2]) < -0.5
    assert sum(kind != '' for kind in opened[0].kinds) == pytest.approx(10, abs=7)


def test_recorded_drives_share_a_frame(real_data: Path, tmp_path: Path) -> None:
    folders = sorted({path.parent for path in real_data.rglob('radar.timestamps')})
    folders = [folder for folder in folders if (folder / 'gps').is_dir()][:1]
    if not folders:
        pytest.skip('no recorded drive with positions')
    drives = recorded_drives([str(folders[0])] * 2, 0.0)
    assert drives[0] == drives[1]
    (cached,) = cached_drives(tmp_path, drives[:1], REDUCTION)
    assert np.isfinite(cached.poses[:, :2]).all()
    assert np.isnan(cached.severities).all()
    sequence = drives[0].open()
    expected = make_image(NETWORK)(sequence.sequence.scan(int(sequence.indices[0])))
    assert np.array_equal(make_image(NETWORK)(cached.scan(0)), expected)
