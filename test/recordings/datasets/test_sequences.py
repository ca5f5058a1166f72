from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offradar_ros.config import RadarConfig
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.recordings.datasets.registry import LAYOUTS, open_sequence
from offradar_ros.recordings.datasets.sequence import RecordedSequence
from offradar_ros.sequence import RadarSequence

START_NS = 1_561_000_444_390_857_630
PERIOD_NS = 250_000_000
Writers = dict[str, Callable[..., Any]]


def mulran(root: Path, writers: Writers, folder: str, count: int = 3, *, oxford_form: bool = True) -> list[int]:
    stamps = [START_NS + PERIOD_NS * k for k in range(count)]
    for stamp in stamps:
        scan = writers['scan'](stamp, 3360)
        image = writers['metadata'](scan, microseconds=False) if oxford_form else scan.power.T
        writers['png'](root / folder / f'{stamp}.png', image)
    return stamps


def name_of_positions(sequence: RecordedSequence) -> str | None:
    return sequence.trajectory_path.name if sequence.trajectory_path else None


def test_oxford(oxford_folder: Path, scan_writers: Writers) -> None:
    for given in (oxford_folder, oxford_folder / 'radar', str(oxford_folder)):
        sequence = open_sequence(given)
        assert isinstance(sequence, RadarSequence)
        assert (sequence.name, sequence.layout, len(sequence)) == (oxford_folder.name, 'oxford', 6)
        assert sequence.warnings == ()
        assert set(np.diff(sequence.stamps_ns).tolist()) == {PERIOD_NS}
        scan = sequence.scan(4)
        made = scan_writers['scan'](int(sequence.stamps_ns[4]))
        assert np.array_equal(scan.power, made.power)
        np.testing.assert_array_equal(scan.azimuth_stamps_ns, made.azimuth_stamps_ns)
        assert scan.stamp_ns == sequence.stamps_ns[4]
        assert sequence.trajectory is not None
        assert len(sequence.trajectory.stamps_ns) == 20
        assert sequence.trajectory_path == oxford_folder / 'gps' / 'gps.csv'


def test_oxford_without_its_list_or_positions(oxford_folder: Path) -> None:
    (oxford_folder / 'radar.timestamps').unlink()
    shutil.rmtree(oxford_folder / 'gps')
    sequence = open_sequence(oxford_folder)
    assert (sequence.layout, sequence.trajectory, sequence.trajectory_path) == ('oxford', None, None)


def write_ins(root: Path, statuses: list[str]) -> None:
    start_us = 1_547_131_045_000_000
    rows = [f'{start_us + 200_000 * k},{status},51.76,-1.26,65,0.1' for k, status in enumerate(statuses)]
    header = 'timestamp,ins_status,latitude,longitude,altitude,yaw'
    (root / 'gps' / 'ins.csv').write_text('\n'.join([header, *rows]) + '\n')


def test_the_ins_is_preferred_where_it_covers_the_scans(oxford_folder: Path) -> None:
    write_ins(oxford_folder, ['INS_SOLUTION_GOOD'] * 20)
    assert name_of_positions(open_sequence(oxford_folder)) == 'ins.csv'
    write_ins(oxford_folder, ['INS_SOLUTION_GOOD'] * 3 + ['INS_ALIGNING'] * 17)
    assert name_of_positions(open_sequence(oxford_folder)) == 'gps.csv'
    write_ins(oxford_folder, ['INS_ALIGNING'] * 20)
    assert name_of_positions(open_sequence(oxford_folder)) == 'gps.csv'


def test_a_damaged_position_file_is_an_error_only_when_positions_are_asked_for(oxford_folder: Path) -> None:
    (oxford_folder / 'gps' / 'gps.csv').write_text('nothing\n')
    sequence = open_sequence(oxford_folder)
    assert sequence.scan(0).power.any()
    with pytest.raises(DataError, match=r'gps\.csv, line 1'):
        _ = sequence.trajectory


@pytest.mark.parametrize('above', ['', 'sensor_data/radar/', 'radar/', 'sensor_data/'])
@pytest.mark.parametrize('folder', ['polar_oxford_form', 'polar'])
def test_mulran_scans_are_found_in_every_folder(tmp_path: Path, scan_writers: Writers, above: str, folder: str) -> None:
    root = tmp_path / 'KAIST03'
    stamps = mulran(root, scan_writers, above + folder, oxford_form=folder != 'polar')
    (root / 'global_pose.csv').write_text(f'{START_NS},1,0,0,350000,0,1,0,4026000,0,0,1,20\n')
    for given in (root, root / above / folder):
        sequence = open_sequence(given)
        assert sequence.layout == ('mulran_polar' if folder == 'polar' else 'mulran')
        assert sequence.name == 'KAIST03'
        assert sequence.stamps_ns.tolist() == stamps
        scan = sequence.scan(1)
        assert np.array_equal(scan.power, scan_writers['scan'](stamps[1], 3360).power)
        assert sequence.trajectory_path == root / 'global_pose.csv'


def test_mulran_falls_back_to_its_receiver(tmp_path: Path, scan_writers: Writers) -> None:
    root = tmp_path / 'Riverside01'
    mulran(root, scan_writers, 'sensor_data/radar/polar', oxford_form=False)
    (root / 'sensor_data' / 'gps.csv').write_text(f'{START_NS},36.3,127.3,60' + ',0' * 9 + '\n')
    assert name_of_positions(open_sequence(root)) == 'gps.csv'


def indexed_polar(root: Path, writers: Writers, indices: list[int]) -> None:
    for k in indices:
        writers['png'](root / 'polar' / f'{k:06d}.png', writers['scan'](START_NS + PERIOD_NS * k, 3360).power.T)


def test_numbered_polar_images_take_their_stamps_from_the_list(tmp_path: Path, scan_writers: Writers) -> None:
    indexed_polar(tmp_path, scan_writers, [0, 2])
    listed = [START_NS + 251_000_000 * k for k in range(3)]
    (tmp_path / 'sensor_data').mkdir()
    (tmp_path / 'sensor_data' / 'navtech_top_stamp.csv').write_text(''.join(f'{stamp}\n' for stamp in listed))
    sequence = open_sequence(tmp_path)
    assert sequence.stamps_ns.tolist() == [listed[0], listed[2]]
    assert sequence.warnings == ()


def test_or_from_the_list_of_all_sensors(tmp_path: Path, scan_writers: Writers) -> None:
    indexed_polar(tmp_path, scan_writers, [0, 1])
    lines = [f'{START_NS + 1},imu', f'{START_NS + 2},radar', f'{START_NS + 3},gps', f'{START_NS + 4},radar']
    (tmp_path / 'data_stamp.csv').write_text('\n'.join(lines))
    assert open_sequence(tmp_path).stamps_ns.tolist() == [START_NS + 2, START_NS + 4]


def test_or_from_the_other_layout(tmp_path: Path, scan_writers: Writers) -> None:
    indexed_polar(tmp_path, scan_writers, [0, 1])
    for k in range(2):
        image = scan_writers['metadata'](scan_writers['scan'](START_NS + PERIOD_NS * k, 3360), microseconds=False)
        scan_writers['png'](tmp_path / 'polar_oxford_form' / f'{k:06d}.png', image)
    sequence = open_sequence(tmp_path, 'mulran_polar')
    assert sequence.stamps_ns.tolist() == [START_NS, START_NS + PERIOD_NS]
    assert open_sequence(tmp_path).layout == 'mulran'
    assert open_sequence(tmp_path).stamps_ns.tolist() == sequence.stamps_ns.tolist()


def test_or_are_assumed_with_a_warning(tmp_path: Path, scan_writers: Writers) -> None:
    indexed_polar(tmp_path, scan_writers, [0, 1, 3])
    sequence = open_sequence(tmp_path)
    assert sequence.stamps_ns.tolist() == [0, PERIOD_NS, 3 * PERIOD_NS]
    assert len(sequence.warnings) == 1
    assert 'assumed 0.25 s a scan' in sequence.warnings[0]


def ray_text(writers: Writers, stamp: int, bins: int = 3360) -> str:
    scan = writers['scan'](stamp, bins, 400)
    lines = []
    for k in range(400):
        powers = ','.join(str(v) for v in scan.power[k])
        lines.append(f'{stamp - (399 - k) * 625_000},{(9 + 14 * k) * 360 / 5600},{9 + 14 * k},{42653 + k},{powers}')
    return '\n'.join(lines) + '\n'


@pytest.mark.parametrize('folder', ['', 'ray', 'sensor_data/radar/ray'])
def test_ray_files(tmp_path: Path, scan_writers: Writers, folder: str) -> None:
    root = tmp_path / 'KAIST01'
    (root / folder).mkdir(parents=True)
    (root / folder / f'{START_NS}.csv').write_text(ray_text(scan_writers, START_NS))
    sequence = open_sequence(root)
    assert (sequence.layout, sequence.name, sequence.stamps_ns.tolist()) == ('mulran_ray', 'KAIST01', [START_NS])
    scan = sequence.scan(0)
    assert np.array_equal(scan.power, scan_writers['scan'](START_NS, 3360, 400).power)
    assert scan.azimuths_rad == pytest.approx((9 + 14 * np.arange(400)) * 2 * np.pi / 5600)
    assert scan.azimuth_stamps_ns is not None
    assert scan.azimuth_stamps_ns[-1] == START_NS


DAMAGED_LINES: dict[str, Callable[[str], str]] = {
    'another column': lambda line: line + ',7',
    'a power of 256': lambda line: line.rpartition(',')[0] + ',256',
    'a power below 0': lambda line: line.rpartition(',')[0] + ',-1',
    'no stamp': lambda line: 'x' + line.partition(',')[1] + line.partition(',')[2],
    'no line': lambda line: '',
    'no text': lambda line: line[:40] + '\xe9' + line[41:],
    'an azimuth that is no number': lambda line: ','.join([line.split(',')[0], 'nan', *line.split(',')[2:]]),
}


@pytest.mark.parametrize('kind', DAMAGED_LINES)
@pytest.mark.parametrize('count', [1, 40])
def test_a_damaged_line_of_a_ray_file_is_a_row_without_power(
    tmp_path: Path, scan_writers: Writers, kind: str, count: int
) -> None:
    lines = ray_text(scan_writers, START_NS, 100).splitlines()
    at = np.linspace(0, 399, count).astype(int)
    for row in at:
        lines[row] = DAMAGED_LINES[kind](lines[row])
    (tmp_path / f'{START_NS}.csv').write_text('\n'.join(lines) + '\n', encoding='latin-1')
    scan = open_sequence(tmp_path, radar=RadarConfig(range_resolution_m=0.06)).scan(0)
    assert scan.row_faults == {'damaged': count, 'no_power': count}
    assert scan.azimuths_rad == pytest.approx((9 + 14 * np.arange(400)) * 2 * np.pi / 5600)
    sound = np.delete(np.arange(400), at)
    assert np.array_equal(scan.power[sound], scan_writers['scan'](START_NS, 100, 400).power[sound])
    assert not scan.power[at].any()


@pytest.mark.parametrize(('before', 'after'), [('\ufeff', ''), ('', '\n'), ('', ' \n\n')])
def test_a_ray_file_with_a_mark_or_blank_lines_at_its_ends_is_sound(
    tmp_path: Path, scan_writers: Writers, before: str, after: str
) -> None:
    """As editors leave them."""
    text = ray_text(scan_writers, START_NS, 100)
    (tmp_path / f'{START_NS}.csv').write_text(before + text.rstrip() + '\n' + after)
    scan = open_sequence(tmp_path, radar=RadarConfig(range_resolution_m=0.06)).scan(0)
    assert (len(scan.power), scan.row_faults) == (400, {})


@pytest.mark.parametrize('kind', DAMAGED_LINES)
def test_a_ray_file_of_damaged_lines_is_named_by_the_first(tmp_path: Path, scan_writers: Writers, kind: str) -> None:
    path = tmp_path / f'{START_NS}.csv'
    lines = ray_text(scan_writers, START_NS, 100).splitlines()
    for row in range(100, 141):
        lines[row] = DAMAGED_LINES[kind](lines[row])
    path.write_text('\n'.join(lines), encoding='latin-1')
    sequence = open_sequence(tmp_path, radar=RadarConfig(range_resolution_m=0.06))
    with pytest.raises(DataError, match=rf'{START_NS}\.csv, line 101: .*41 of 400 lines are damaged'):
        sequence.scan(0)


def radiate(root: Path, writers: Writers, count: int = 4) -> Path:
    for k in range(1, count + 1):
        writers['png'](root / 'Navtech_Polar' / f'{k:06d}.png', writers['scan'](START_NS + k, 576).power.T)
    listing = root / 'Navtech_Polar.txt'
    listing.write_text(''.join(f'Frame: {k:06d} Time: 1574859771.{k}00000001\n' for k in range(1, count + 1)))
    return listing


def test_radiate(tmp_path: Path, scan_writers: Writers) -> None:
    radiate(tmp_path, scan_writers)
    sequence = open_sequence(tmp_path / 'Navtech_Polar')
    assert sequence.stamps_ns.tolist() == [1_574_859_771_000_000_001 + 100_000_000 * k for k in range(1, 5)]
    scan = sequence.scan(2)
    assert np.array_equal(scan.power, scan_writers['scan'](START_NS + 3, 576).power)
    assert scan.range_resolution_m == 0.1736
    assert sequence.warnings == ()


def test_differences_between_list_and_files_of_radiate_are_warnings(tmp_path: Path, scan_writers: Writers) -> None:
    listing = radiate(tmp_path, scan_writers)
    (tmp_path / 'Navtech_Polar' / '000002.png').unlink()
    lines = listing.read_text().splitlines()
    listing.write_text('\n'.join([lines[0], lines[1], lines[3].replace('.4', '.05')]))
    sequence = open_sequence(tmp_path)
    assert [file.name for file in sequence.files] == ['000004.png', '000001.png']
    assert len(sequence.warnings) == 3
    assert all('Navtech_Polar.txt' in warning for warning in sequence.warnings)


@pytest.mark.parametrize('text', ['', 'Frame: 1 Time: x\n', 'Frame: 000001 Time: 12\n', 'hello\n', None])
def test_radiate_needs_its_list(tmp_path: Path, scan_writers: Writers, text: str | None) -> None:
    listing = radiate(tmp_path, scan_writers, 1)
    listing.unlink()
    if text is not None:
        listing.write_text(text)
    with pytest.raises(DataError, match=r'Navtech_Polar\.txt'):
        open_sequence(tmp_path)


def test_boreas(tmp_path: Path, scan_writers: Writers) -> None:
    stamp_us = START_NS // 1000
    image = scan_writers['metadata'](scan_writers['scan'](stamp_us * 1000, 3360), microseconds=True)
    scan_writers['png'](tmp_path / 'radar' / f'{stamp_us}.png', image)
    (tmp_path / 'applanix').mkdir()
    header = 'GPSTime,easting,northing,altitude,heading'
    (tmp_path / 'applanix' / 'radar_poses.csv').write_text(f'{header}\n{stamp_us},623425,4848820,154,0.2\n')
    sequence = open_sequence(tmp_path)
    assert (sequence.layout, sequence.stamps_ns.tolist()) == ('boreas', [stamp_us * 1000])
    assert sequence.trajectory is not None
    assert sequence.trajectory.positions[0] == pytest.approx([43.78, -79.47, 154], abs=0.01)


def test_unnamed_files_with_metadata_are_stamped_by_their_first_row(tmp_path: Path, scan_writers: Writers) -> None:
    for k, name in enumerate(['b', 'a']):
        image = scan_writers['metadata'](scan_writers['scan'](START_NS + k * PERIOD_NS, 3360), microseconds=False)
        scan_writers['png'](tmp_path / f'{name}.png', image)
    sequence = open_sequence(tmp_path)
    assert sequence.stamps_ns.tolist() == [START_NS, START_NS + PERIOD_NS]
    assert [file.name for file in sequence.files] == ['b.png', 'a.png']


def test_a_scan_without_signal_is_refused_with_its_file(oxford_folder: Path, scan_writers: Writers) -> None:
    sequence = open_sequence(oxford_folder)
    scan = sequence.scan(2)
    image = scan_writers['metadata'](scan, microseconds=True)
    image[:, 11:] = 0
    scan_writers['png'](sequence.files[2], image)
    with pytest.raises(RefusedInput, match=sequence.files[2].name) as refused:
        sequence.scan(2)
    assert refused.value.cause == 'no_signal'


def test_nothing_recognised_lists_what_was_looked_for(tmp_path: Path) -> None:
    with pytest.raises(DataError) as error:
        open_sequence(tmp_path)
    assert all(name in str(error.value) for name in LAYOUTS)
    for name, layout in LAYOUTS.items():
        with pytest.raises(DataError) as error:
            open_sequence(tmp_path, name)
        assert layout.looks_for in str(error.value)
    assert '\n' not in str(error.value)


def test_wrong_arguments_are_errors(tmp_path: Path, oxford_folder: Path) -> None:
    with pytest.raises(DataError, match='no such folder'):
        open_sequence(tmp_path / 'missing')
    (tmp_path / 'file').write_text('')
    with pytest.raises(DataError, match='not a folder'):
        open_sequence(tmp_path / 'file')
    with pytest.raises(DataError, match="layout 'kitti' is unknown: expected auto, radiate"):
        open_sequence(oxford_folder, 'kitti')
    with pytest.raises(DataError, match='looked for Navtech_Polar'):
        open_sequence(oxford_folder, 'radiate')


@pytest.mark.parametrize(
    ('folder', 'layout', 'scans', 'shape', 'positions'),
    [
        ('oxford_tiny', 'oxford', 11, (400, 3768), 'gps.csv'),
        ('mulran_kaist03', 'mulran', 3, (400, 3360), 'mulran_KAIST03_radar_utm.csv'),
        ('mulran_kaist03/polar', 'mulran_polar', 2, (400, 3360), 'mulran_KAIST03_radar_utm.csv'),
        ('mulran_ray', 'mulran_ray', 1, (400, 3360), None),
        ('radiate_tiny_foggy', 'radiate', 18, (400, 576), 'GPS_IMU_Twist.txt'),
        ('utias_frame', 'boreas', 1, (400, 6848), None),
    ],
)
def test_recorded_folders(
    real_data: Path, folder: str, layout: str, scans: int, shape: tuple[int, int], positions: str | None
) -> None:
    sequence = open_sequence(real_data / folder)
    assert (sequence.layout, len(sequence), sequence.warnings) == (layout, scans, ())
    assert sequence.scan(scans - 1).power.shape == shape
    assert name_of_positions(sequence) == positions


def test_both_layouts_of_kaist03_hold_the_same_scans(real_data: Path) -> None:
    rows = open_sequence(real_data / 'mulran_kaist03', 'mulran')
    columns = open_sequence(real_data / 'mulran_kaist03', 'mulran_polar')
    for k in range(2):
        a, b = rows.scan(k), columns.scan(k)
        assert a.azimuth_stamps_ns is not None
        assert a.stamp_ns == b.stamp_ns == a.azimuth_stamps_ns[0]
        assert np.array_equal(a.power, b.power)
        # Bare polar does not know the encoder, which starts 7 of 5600 counts after zero.
        assert a.azimuths_rad - b.azimuths_rad == pytest.approx(np.full(400, 7 / 5600 * 2 * np.pi))


def test_a_remark_reports_what_bare_polar_does_not_contain(tmp_path: Path, scan_writers: Writers) -> None:
    mulran(tmp_path / 'KAIST01', scan_writers, 'sensor_data/radar/polar', oxford_form=False)
    (remark,) = open_sequence(tmp_path / 'KAIST01').remarks
    assert remark.startswith('polar without polar_oxford_form: ')
    assert 'ray' not in remark
    (tmp_path / 'KAIST01' / 'ray').mkdir()
    (tmp_path / 'KAIST01' / 'ray' / f'{START_NS}.csv').write_text('')
    (remark,) = open_sequence(tmp_path / 'KAIST01').remarks
    assert remark.endswith('--layout mulran_ray reads that')
    mulran(tmp_path / 'KAIST01', scan_writers, 'sensor_data/radar/polar_oxford_form')
    assert open_sequence(tmp_path / 'KAIST01').remarks == ()
    assert open_sequence(tmp_path / 'KAIST01', 'mulran_polar').remarks == ()


def test_the_step_between_both_forms_is_the_one_that_is_said(real_data: Path) -> None:
    """Half of 0.9°, by which the encoder of polar_oxford_form is ahead of bare polar's rows."""
    both = [open_sequence(real_data / 'mulran_kaist03', layout).scan(0) for layout in ('mulran', 'mulran_polar')]
    np.testing.assert_array_equal(both[0].power, both[1].power)
    steps_deg = np.degrees(both[0].azimuths_rad - both[1].azimuths_rad)
    np.testing.assert_allclose(steps_deg, 0.45, atol=1e-6)
    np.testing.assert_allclose(np.radians(0.45), 0.00785, atol=5e-6)


def test_a_remark_reports_what_the_ray_form_contains(real_data: Path) -> None:
    sequence = open_sequence(real_data / 'mulran_ray')
    (remark,) = sequence.remarks
    assert remark.startswith('ray without polar_oxford_form: nothing is missing')
    row_stamps_ns = sequence.scan(0).azimuth_stamps_ns
    assert row_stamps_ns is not None
    assert row_stamps_ns[-1] == sequence.stamps_ns[0]


@pytest.mark.parametrize('folder', ['polar', 'polar_oxford_form'])
def test_mulran_scans_that_are_listed_but_missing_are_warnings(
    tmp_path: Path, scan_writers: Writers, folder: str
) -> None:
    stamps = mulran(tmp_path, scan_writers, folder, oxford_form=folder != 'polar')
    listing = tmp_path / 'data_stamp.csv'
    lines = [f'{stamp},radar' for stamp in (*stamps[1:], stamps[2] + PERIOD_NS)]
    listing.write_text('\n'.join([f'{stamps[0]},imu', *lines]))
    assert open_sequence(tmp_path).warnings == (
        f'{listing}: 1 of 3 listed scans have no file, first {stamps[2] + PERIOD_NS}.png',
        f'{listing}: 1 of 3 files are not listed, first {stamps[0]}.png',
    )
    listing.write_text(f'{stamps[0] + 1},radar\n')
    assert open_sequence(tmp_path).warnings == ()
    listing.write_text('soon,radar\n')
    (warning,) = open_sequence(tmp_path).warnings
    assert warning.startswith(f'{listing}, line 1: expected a stamp in ns')
