"""Every form in which rows come gives the same scan, or is refused for the same cause."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.config import EncoderConfig, RadarConfig
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.messages import scan_from_image
from offradar_ros.radar.image import decode_polar_image
from offradar_ros.radar.png import decode_png
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.writer import image_message, write_bag
from offradar_ros.recordings.datasets.mulran_ray import read_ray_scan
from offradar_ros.recordings.datasets.registry import open_sequence
from offradar_ros.ros.navtech import scan_from_b_scan
from offradar_ros.types import PolarScan

STAMP_NS = 1_767_225_600_000_000_000
ROWS, BINS = 400, 576
RADAR = RadarConfig()


@dataclasses.dataclass(frozen=True)
class Made:
    """What a sensor wrote of one scan."""

    stamps_ns: NDArray[np.int64]
    counts: NDArray[np.int64]
    power: NDArray[np.uint8]


def sound(seed: int = 0) -> Made:
    power = np.random.default_rng(seed).integers(10, 40, (ROWS, BINS)).astype(np.uint8)
    for at in np.random.default_rng(seed + 1).integers(0, ROWS - 20, 40):
        power[at : at + 15, 30 + at : 36 + at] = 200
    stamps_ns = STAMP_NS + 625_000 * np.arange(ROWS, dtype=np.int64)
    return Made(stamps_ns, 7 + 14 * np.arange(ROWS, dtype=np.int64), power)


def stored(made: Made) -> NDArray[np.uint8]:
    image = np.empty((ROWS, 11 + BINS), np.uint8)
    image[:, :8] = made.stamps_ns.astype('<i8').reshape(-1, 1).view(np.uint8)
    image[:, 8:10] = made.counts.astype('<u2').reshape(-1, 1).view(np.uint8)
    image[:, 10] = 255
    image[:, 11:] = made.power
    return image


def from_png(made: Made, folder: Path) -> PolarScan:
    path = folder / 'polar_oxford_form' / f'{STAMP_NS}.png'
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), stored(made))
    return open_sequence(folder, 'mulran', RADAR).scan(0)


def from_live_image(made: Made, folder: Path) -> PolarScan:
    image = stored(made)
    message = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=STAMP_NS // 10**9, nanosec=STAMP_NS % 10**9)),
        height=ROWS, width=11 + BINS, step=11 + BINS, encoding='8UC1', data=image.tobytes(),
    )  # fmt: skip
    return scan_from_image(message, RADAR)


def from_bag(made: Made, folder: Path) -> PolarScan:
    """What is converted is what was read."""
    from_png(made, folder)
    write_bag(open_sequence(folder, 'mulran', RADAR), folder / 'bag')
    return BagSequence(folder / 'bag').scan(0)


def from_navtech(made: Made, folder: Path) -> PolarScan:
    image = image_message(PolarScan(STAMP_NS, made.power, made.counts.astype(float), 0.1736), plain=True)
    message = SimpleNamespace(b_scan_img=image, encoder_values=made.counts.tolist(), timestamps=made.stamps_ns.tolist())
    return scan_from_b_scan(message, RADAR)


def from_ray(made: Made, folder: Path) -> PolarScan:
    path = folder / f'{STAMP_NS}.csv'
    rows = zip(made.stamps_ns.tolist(), made.counts.tolist(), made.power.tolist(), strict=True)
    lines = (f'{stamp},{count * 360 / 5600},{count},1,{",".join(map(str, power))}' for stamp, count, power in rows)
    path.write_text('\n'.join(lines) + '\n')
    return read_ray_scan(path, STAMP_NS, RADAR)


FORMS: dict[str, Callable[[Made, Path], PolarScan]] = {
    'PNG': from_png,
    'live image': from_live_image,
    'bag': from_bag,
    "Navtech's message": from_navtech,
    'ray': from_ray,
}
SOUND = sound()


def changed(at: Any, **columns: Any) -> Made:
    """The sound scan with other values in some rows."""
    replaced = {}
    for name, values in columns.items():
        column = getattr(SOUND, name).copy()
        column[at] = values
        replaced[name] = column
    return dataclasses.replace(SOUND, **replaced)


MENDED = {
    'nothing': SOUND,
    'counts from 14 to a full turn': dataclasses.replace(SOUND, counts=14 * np.arange(1, 401)),
    'one count of a full turn': changed(200, counts=5600),
    'one count of any number': changed(77, counts=60_000),
    'a tenth of the counts': changed(np.arange(5, 400, 10), counts=np.arange(40) * 1601 % 65536),
    'a row twice': changed([100], counts=SOUND.counts[99], stamps_ns=SOUND.stamps_ns[99], power=SOUND.power[99]),
    'rows out of order': changed([50, 51], counts=SOUND.counts[[51, 50]], stamps_ns=SOUND.stamps_ns[[51, 50]]),
    'a stamp of another year': changed(12, stamps_ns=STAMP_NS - 10**17),
    'counts of 16000 a turn': dataclasses.replace(SOUND, counts=20 + 40 * np.arange(400)),
    'rows without power': changed([3, 4], power=0),
    'saturated rows': changed([3, 4], power=255),
}


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('kind', MENDED)
def test_every_form_gives_the_same_scan(tmp_path: Path, form: str, kind: str) -> None:
    made = MENDED[kind]
    scan, same = FORMS[form](made, tmp_path), from_live_image(made, tmp_path)
    assert np.array_equal(scan.power, made.power)
    # A bag holds angles in counts of 5600.
    assert scan.azimuths_rad == pytest.approx(same.azimuths_rad, abs=np.pi / 5600 if form == 'bag' else 1e-12)
    assert scan.azimuth_stamps_ns is not None
    assert same.azimuth_stamps_ns is not None
    assert np.array_equal(scan.azimuth_stamps_ns, same.azimuth_stamps_ns)
    assert (scan.stamp_ns, scan.range_resolution_m) == (STAMP_NS, 0.1736)
    if form != 'bag':
        assert scan.row_faults == same.row_faults


REFUSED = {
    'no_row_angles': dataclasses.replace(SOUND, counts=np.zeros(400, np.int64)),
    'unknown_turn': dataclasses.replace(SOUND, counts=20 * np.arange(400)),
    'unsound_rows': changed(np.arange(3, 400, 5), counts=np.arange(80) * 1601 % 65536),
}


# The azimuth of a ray file takes the place of a missing count.
@pytest.mark.parametrize(
    ('form', 'cause'), [(f, c) for f in FORMS for c in REFUSED if (f, c) != ('ray', 'no_row_angles')]
)
def test_every_form_is_refused_for_the_same_cause(tmp_path: Path, form: str, cause: str) -> None:
    if form == 'bag':
        # Nothing that is refused is written.
        from_png(sound(), tmp_path)
        other = tmp_path / 'polar_oxford_form' / f'{STAMP_NS + 250_000_000}.png'
        cv2.imwrite(str(other), stored(REFUSED[cause]))
        causes: list[str] = []
        write_bag(
            open_sequence(tmp_path, 'mulran', RADAR),
            tmp_path / 'bag',
            unreadable=lambda _, error: causes.append(getattr(error, 'cause', '')),
        )
        assert causes == [cause]
        assert len(BagSequence(tmp_path / 'bag')) == 1
        return
    with pytest.raises(RefusedInput) as refused:
        FORMS[form](REFUSED[cause], tmp_path)
    assert refused.value.cause == cause
    assert 'metadata_columns' not in str(refused.value)


@pytest.mark.parametrize('first_ns', [0, 900 * 10**9])
@pytest.mark.parametrize('form', FORMS)
def test_rows_of_a_clock_that_nobody_set_get_the_stamp_of_the_scan(tmp_path: Path, form: str, first_ns: int) -> None:
    stamps_ns = first_ns + (625_000 * np.arange(ROWS, dtype=np.int64) if first_ns else np.zeros(ROWS, np.int64))
    scan = FORMS[form](dataclasses.replace(SOUND, stamps_ns=stamps_ns), tmp_path)
    assert scan.power.shape == (ROWS, BINS)
    assert scan.azimuths_rad == pytest.approx(SOUND.counts * 2 * np.pi / 5600)
    assert scan.azimuth_stamps_ns is not None
    assert set(scan.azimuth_stamps_ns.tolist()) == {STAMP_NS}
    assert scan.row_faults == ({} if form == 'bag' else {'stamp_unusable': ROWS})


COLUMNS: dict[str, Callable[[NDArray[np.uint8]], None]] = {
    'sound': lambda image: None,
    'zero': lambda image: image[:, :11].fill(0),
    'counts zero': lambda image: image[:, 8:10].fill(0),
    'damaged': lambda image: np.copyto(image[:, :11], np.random.default_rng(0).integers(0, 256, (ROWS, 11), np.uint8)),
}
TURNED: dict[str, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
    'as it is': lambda image: image,
    'by 90 degrees': np.rot90,
    'by 180 degrees': lambda image: np.rot90(image, 2),
    'by 270 degrees': lambda image: np.rot90(image, 3),
    'rows for columns': np.transpose,
}


@pytest.mark.parametrize('turned', TURNED)
@pytest.mark.parametrize('axis', ['auto', 'rows', 'columns'])
def test_metadata_are_recognised_beside_any_number_of_bins(turned: str, axis: str) -> None:
    image = np.ascontiguousarray(TURNED[turned](stored(SOUND)[:, : 11 + 500]))
    fields: dict[str, Any] = {'height': image.shape[0], 'width': image.shape[1], 'step': image.shape[1]}
    config = RadarConfig(range_resolution_m=0.1736, azimuth_axis=axis)
    try:
        scan = decode_polar_image(image, **fields, encoding='8UC1', stamp_ns=STAMP_NS, config=config)
    except RefusedInput as refusal:
        assert refusal.cause == 'turned_image'
    else:
        assert turned == 'as it is'
        assert np.array_equal(scan.power, SOUND.power[:, :500])


@pytest.mark.parametrize('turned', TURNED)
@pytest.mark.parametrize('columns', COLUMNS)
def test_the_11_bytes_are_never_power_unless_it_is_said(turned: str, columns: str) -> None:
    """Though the parameters give the range resolution, with which any number of bins is accepted."""
    image = stored(SOUND)
    COLUMNS[columns](image)
    image = np.ascontiguousarray(TURNED[turned](image))
    fields: dict[str, Any] = {'height': image.shape[0], 'width': image.shape[1], 'step': image.shape[1]}
    fields |= {'encoding': '8UC1', 'stamp_ns': STAMP_NS}
    config = RadarConfig(range_resolution_m=0.1736)
    try:
        scan = decode_polar_image(image, **fields, config=config)
    except RefusedInput as refusal:
        assert refusal.cause in ('no_row_angles', 'turned_image', 'unreadable_metadata')
    else:
        assert (turned, columns) == ('as it is', 'sound')
        assert np.array_equal(scan.power, SOUND.power)
    all_power = dataclasses.replace(config, metadata_columns='0')
    assert sorted(decode_polar_image(image, **fields, config=all_power).power.shape) == [ROWS, BINS + 11]


def test_equal_steps_are_taken_where_counts_are_missing(tmp_path: Path) -> None:
    path = tmp_path / 'scan.png'
    cv2.imwrite(str(path), stored(REFUSED['no_row_angles']))
    scan = decode_png(path, STAMP_NS, RadarConfig(metadata_columns='11', row_angles='equal'))
    assert np.array_equal(scan.power, SOUND.power)
    assert scan.azimuths_rad == pytest.approx(np.radians(0.9 * np.arange(ROWS)))
    assert scan.azimuth_stamps_ns is not None


@pytest.mark.parametrize('wrong', [1, 10, 40])
def test_mended_counts_leave_the_embedding_as_it_is(tmp_path: Path, wrong: int) -> None:
    """The distance to the sound scan is a small part of the distance to another one."""
    encoder = make_encoder(EncoderConfig())
    random = np.random.default_rng(wrong)
    made = changed(random.permutation(ROWS)[:wrong], counts=random.integers(0, 65536, wrong))
    mended, true, other = (encoder.encode(from_live_image(m, tmp_path)).mean for m in (made, SOUND, sound(50)))
    assert np.linalg.norm(mended - true) < 0.05 * np.linalg.norm(other - true)
