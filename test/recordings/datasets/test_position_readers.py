from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyproj
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.geometry import LocalFrame, Trajectory, wrap_angle, yaw_of_quaternion
from offradar_ros.recordings.datasets.positions import (
    read_global_pose,
    read_gps_twist,
    read_mulran_gps,
    read_oxford_gps,
    read_oxford_ins,
    read_radar_poses,
    read_radar_utm,
    read_tum,
)

GPS_HEADER = 'timestamp,num_satellites,latitude,longitude,altitude,northing'
INS_HEADER = (
    'timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,velocity_north,velocity_east,'
    'velocity_down,roll,pitch,yaw'
)
BOREAS_HEADER = 'GPSTime,easting,northing,altitude,vel_east,vel_north,vel_up,roll,pitch,heading'
US = 1_547_131_010_000_000


def written(tmp_path: Path, *lines: str) -> Path:
    path = tmp_path / 'positions.csv'
    path.write_text('\n'.join(lines) + '\n')
    return path


def ins_row(stamp: int, status: str = 'INS_SOLUTION_GOOD', yaw: float = 0.0) -> str:
    return f'{stamp},{status},51.76,-1.26,65.0,5736000,619890,-65,30U,0,0,0,0.01,0.02,{yaw}'


def test_oxford_gps(tmp_path: Path) -> None:
    rows = [f'000{US},7,51.762042,-1.26275,65.1,1', f'000{US + 200000},7,51.76205,-1.26276,66,1']
    path = written(tmp_path, GPS_HEADER, *rows)
    trajectory = read_oxford_gps(path)
    assert trajectory.geodetic
    assert trajectory.stamps_ns.tolist() == [US * 1000, (US + 200000) * 1000]
    assert trajectory.positions.tolist() == [[51.762042, -1.26275, 65.1], [51.76205, -1.26276, 66.0]]
    assert np.isnan(trajectory.yaws_rad).all()


def test_rows_without_a_fix_and_repeated_stamps_are_left_out_and_counted(tmp_path: Path) -> None:
    rows = [f'{US},0,0,0,0,1', f'{US + 1},0,nan,nan,nan,1', f'{US + 2},7,51,-1,65,1', f'{US + 2},7,52,-1,65,1']
    tally: Counter[str] = Counter()
    trajectory = read_oxford_gps(written(tmp_path, GPS_HEADER, *rows), tally)
    assert trajectory.positions.tolist() == [[51.0, -1.0, 65.0]]
    assert tally == {'no_fix': 2, 'repeated_position_stamp': 1}


def test_oxford_ins_keeps_good_rows_only(tmp_path: Path) -> None:
    rows = [
        ins_row(US, 'INS_ALIGNING'),
        ins_row(US + 20_000, yaw=0.0),
        ins_row(US + 40_000, yaw=math.pi / 2),
        ins_row(US + 60_000, 'SOLUTION_FREE'),
        ins_row(US + 80_000, yaw=-math.pi / 4),
    ]
    tally: Counter[str] = Counter()
    trajectory = read_oxford_ins(written(tmp_path, INS_HEADER, *rows), tally)
    # Clockwise from north in the file: north, east, north-west.
    assert trajectory.yaws_rad == pytest.approx([math.pi / 2, 0.0, 3 * math.pi / 4])
    assert tally == {'status INS_ALIGNING': 1, 'status SOLUTION_FREE': 1}


def test_no_good_row_at_all_is_an_error_that_says_so(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r'holds no position \(2 status INS_ALIGNING\)'):
        read_oxford_ins(written(tmp_path, INS_HEADER, ins_row(US, 'INS_ALIGNING'), ins_row(US + 1, 'INS_ALIGNING')))


def test_global_pose_is_utm_with_a_rotation(tmp_path: Path) -> None:
    to_utm = pyproj.Transformer.from_crs(4326, 32652, always_xy=True)
    easting, northing = to_utm.transform(127.362, 36.368)
    cos, sin = math.cos(2.0), math.sin(2.0)
    pose = f'{cos},{-sin},0,{easting},{sin},{cos},0,{northing},0,0,1,21.5'
    path = written(tmp_path, f'1561000452974693000,{pose}', f'1561000453225385000,{pose}')
    trajectory = read_global_pose(path)
    assert trajectory.positions[1] == pytest.approx([36.368, 127.362, 21.5], abs=1e-9)
    # Grid north leans 0.97° west of true north there, so that the true heading is that much larger.
    assert trajectory.yaws_rad[0] - 2.0 == pytest.approx(math.radians(0.97), abs=math.radians(0.02))


@pytest.mark.parametrize('epsg', [32652, 32617, 32630])
def test_yaw_from_utm_is_the_way_the_vehicle_goes(tmp_path: Path, epsg: int) -> None:
    start, heading = np.array([620_000.0, 4_800_000.0]), 0.7
    points = [start + 5.0 * k * np.array([math.cos(heading), math.sin(heading)]) for k in range(5)]
    rows = [f'{US + 250_000 * k},{e:.6f},{n:.6f},{heading}' for k, (e, n) in enumerate(points)]
    trajectory = read_radar_utm(written(tmp_path, 'timestamp_us,utm_e,utm_n,yaw', *rows), None, epsg)
    origin = trajectory.origin()
    assert origin is not None
    east, north, _ = (trajectory.in_frame(LocalFrame(origin)).positions[-1]).tolist()
    assert math.atan2(north, east) == pytest.approx(trajectory.yaws_rad[0], abs=1e-4)
    assert math.hypot(north, east) == pytest.approx(20.0, rel=1e-3)


def test_mulran_gps(tmp_path: Path) -> None:
    path = written(tmp_path, '1561000452974693000,36.36,127.36,60.5,' + ','.join('000000000'))
    trajectory = read_mulran_gps(path)
    assert trajectory.positions.tolist() == [[36.36, 127.36, 60.5]]


@pytest.mark.parametrize('factor', [1, 1000])
def test_boreas_stamps_may_be_in_either_unit(tmp_path: Path, factor: int) -> None:
    row = '623425.5,4848820.9,154.0,0,0,0,3.1,0.02,0.25'
    trajectory = read_radar_poses(written(tmp_path, BOREAS_HEADER, f'{US * factor},{row}'))
    assert trajectory.stamps_ns.tolist() == [US * 1000]
    assert trajectory.positions[0] == pytest.approx([43.782, -79.466, 154.0], abs=1e-3)


def test_tum_is_a_local_frame(tmp_path: Path) -> None:
    half = math.sqrt(0.5)
    path = written(tmp_path, '# seconds x y z', '0.000 1 2 3 0 0 0 1', f'0.250 4  5 6 0 0 {half} {half} ')
    trajectory = read_tum(path)
    assert not trajectory.geodetic
    assert trajectory.stamps_ns.tolist() == [0, 250_000_000]
    assert trajectory.positions.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert trajectory.yaws_rad == pytest.approx([0.0, math.pi / 2])


def test_tum_zeros_for_a_quaternion_are_no_heading(tmp_path: Path) -> None:
    tally: Counter[str] = Counter()
    rows = [f'0.{k} {k} 2 3 0 0 0 {0 if k == 3 else 1}' for k in range(8)]
    assert len(read_tum(written(tmp_path, *rows), tally)) == 7
    assert tally == {'damaged': 1}
    with pytest.raises(DataError, match=r'line 1: expected a unit quaternion that says a heading, got none'):
        read_tum(written(tmp_path, '0.0 1 2 3 0 0 0 0', '0.1 2 2 3 0 0 0 0'))


def test_tum_stamps_are_exact(tmp_path: Path) -> None:
    trajectory = read_tum(written(tmp_path, '1547131046.123456789 0 0 0 0 0 0 1'))
    assert trajectory.stamps_ns.tolist() == [1_547_131_046_123_456_789]


def test_radiate_leaves_out_doubled_and_backward_samples(tmp_path: Path) -> None:
    times = ['.100', '.100', '.200', '.150', '.300', '.400']
    listing = tmp_path / 'GPS_IMU_Twist.txt'
    listing.write_text(''.join(f'Frame: {k:06d} Time: 1574859835{t}\n' for k, t in enumerate(times)))
    (tmp_path / 'GPS_IMU_Twist').mkdir()
    for k in range(5):
        (tmp_path / 'GPS_IMU_Twist' / f'{k:06d}.txt').write_text(f'55.8000{k},-3.3,209.2 \n0.02,0,0 \n')
    tally: Counter[str] = Counter()
    trajectory = read_gps_twist(listing, tally)
    assert trajectory.positions[:, 0].tolist() == [55.8, 55.80002, 55.80004]
    assert tally == {'repeated_position_stamp': 1, 'position_stamp_backwards': 1, 'missing sample': 1}


Reader = Callable[..., Trajectory]
GOOD: dict[str, tuple[Reader, list[str]]] = {
    'oxford gps': (read_oxford_gps, [GPS_HEADER, f'{US},7,51,-1,65,1', f'{US + 1},7,51,-1,65,1']),
    'oxford ins': (read_oxford_ins, [INS_HEADER, ins_row(US), ins_row(US + 1)]),
    'mulran gps': (read_mulran_gps, [f'{US}000,36,127,60' + ',0' * 9, f'{US}001,36,127,60' + ',0' * 9]),
    'global pose': (read_global_pose, [f'{US}000,1,0,0,350000,0,1,0,4000000,0,0,1,20'] * 2),
    'radar utm': (
        read_radar_utm,
        ['timestamp_us,utm_e,utm_n,yaw', f'{US},350000,4000000,1', f'{US + 1},350000,4000000,1'],
    ),
    'boreas': (read_radar_poses, [BOREAS_HEADER, f'{US},623425,4848820,154,0,0,0,0,0,0.2']),
    'tum': (read_tum, ['0 1 2 3 0 0 0 1', '1 1 2 3 0 0 0 1']),
}


@pytest.mark.parametrize('name', GOOD)
def test_every_reader_reads_its_file(tmp_path: Path, name: str) -> None:
    reader, lines = GOOD[name]
    assert len(reader(written(tmp_path, *lines))) >= 1


@pytest.mark.parametrize('name', GOOD)
def test_damage_is_named_by_file_and_line(tmp_path: Path, name: str) -> None:
    reader, lines = GOOD[name]
    separator = ' ' if name == 'tum' else ','
    last = lines[-1].split(separator)
    cases = {
        'one column too few': [*lines[:-1], separator.join(last[:-1])],
        'one column too many': [*lines[:-1], separator.join([*last, '1'])],
        'no number': [*lines[:-1], separator.join([last[0], *('x' if c[:1].isdigit() else c for c in last[1:])])],
        'no stamp': [*lines[:-1], separator.join(['x', *last[1:]])],
    }
    for case, damaged in cases.items():
        with pytest.raises(DataError, match=rf'positions\.csv, line {len(lines)}: .*expected') as error:
            reader(written(tmp_path, *damaged))
        assert '\n' not in str(error.value), case


@pytest.mark.parametrize('name', GOOD)
def test_empty_missing_and_binary_files_are_errors(tmp_path: Path, name: str) -> None:
    reader, _ = GOOD[name]
    path = tmp_path / 'positions.csv'
    with pytest.raises(DataError, match='cannot be read'):
        reader(path)
    for content in (b'', b'\n\n', b'\xff\xfe\x00\x01' * 50):
        path.write_bytes(content)
        with pytest.raises(DataError, match=r'positions\.csv'):
            reader(path)


@pytest.mark.parametrize('name', ['oxford gps', 'oxford ins', 'mulran gps', 'radar utm', 'tum'])
def test_stamps_that_go_back_are_an_error(tmp_path: Path, name: str) -> None:
    reader, lines = GOOD[name]
    with pytest.raises(DataError, match=rf'line {len(lines)}: position stamp \d+ ns goes back by'):
        reader(written(tmp_path, *lines[:-2], lines[-1], lines[-2]))


@pytest.mark.parametrize(
    ('reader', 'header', 'missing'),
    [
        (read_oxford_gps, GPS_HEADER, 'altitude'),
        (read_oxford_ins, INS_HEADER, 'ins_status'),
        (read_radar_poses, BOREAS_HEADER, 'heading'),
        (read_radar_utm, 'timestamp_us,utm_e,utm_n,yaw', 'utm_n'),
    ],
)
def test_a_missing_column_is_named(tmp_path: Path, reader: Reader, header: str, missing: str) -> None:
    with pytest.raises(DataError, match=f'line 1: no column {missing}: expected a header with'):
        reader(written(tmp_path, header.replace(missing, 'other'), '1,2,3'))


def test_degrees_beyond_the_earth_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r'line 2: position .* is not on the Earth: expected degrees'):
        read_oxford_gps(written(tmp_path, GPS_HEADER, f'{US},7,5176.2,-1,65,1'))


def test_utm_outside_the_projection_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match='expected UTM easting and northing'):
        read_radar_utm(written(tmp_path, 'timestamp_us,utm_e,utm_n,yaw', f'{US},1e300,4e300,0'))


TABLES = ['oxford gps', 'mulran gps', 'radar utm', 'global pose', 'boreas', 'tum']


def long_table(name: str, rows: int = 40) -> list[str]:
    """A sound table of many rows with growing stamps."""
    _, lines = GOOD[name]
    header = lines[:1] if lines[0][0].isalpha() else []
    separator = ' ' if name == 'tum' else ','
    cells = lines[-1].split(separator)
    first = int(cells[0])
    step = 1 if name == 'tum' else 200_000 * (1 if len(cells[0]) == 16 else 1000)
    return [*header, *(separator.join([str(first + k * step), *cells[1:]]) for k in range(rows))]


def cut(line: str) -> str:
    return line[: len(line) // 2]


ONE_BAD: dict[str, Callable[[list[str]], list[str]]] = {
    'last line cut': lambda rows: [*rows[:-1], cut(rows[-1])],
    'NUL bytes at the end': lambda rows: [*rows[:-1], '\0' * 512],
    'NUL bytes in a line': lambda rows: [*rows[:20], rows[20][:20] + '\0' * 8 + rows[20][28:], *rows[21:]],
    'a line of nonsense': lambda rows: [*rows[:20], 'Segmentation fault (core dumped)', *rows[21:]],
    'a line of bytes': lambda rows: [*rows[:20], '\udcff\udcfe' + rows[20], *rows[21:]],
    'an endless line': lambda rows: [*rows[:20], 'x' * 200_000, *rows[21:]],
    'a quote that is not closed': lambda rows: [*rows[:20], '"' + rows[20], *rows[21:]],
    'one column too many': lambda rows: [
        *rows[:20],
        f'{rows[20]},7' if ',' in rows[20] else f'{rows[20]} 7',
        *rows[21:],
    ],
    'one column too few': lambda rows: [
        *rows[:20],
        rows[20][: max(rows[20].rfind(','), rows[20].rfind(' '))],
        *rows[21:],
    ],
    'two lines in one': lambda rows: [*rows[:20], rows[20] + rows[21], *rows[22:]],
}


@pytest.mark.parametrize('case', ONE_BAD)
@pytest.mark.parametrize('name', TABLES)
def test_one_bad_row_is_left_out_and_told_of(tmp_path: Path, name: str, case: str) -> None:
    reader, _ = GOOD[name]
    rows = ONE_BAD[case](long_table(name))
    path = tmp_path / 'positions.csv'
    path.write_text('\n'.join(rows) + '\n', errors='surrogateescape')
    trajectory = reader(path)
    assert 38 <= len(trajectory) <= 39
    (left_out,) = trajectory.left_out
    assert (left_out.cause, left_out.count) == ('damaged', 1)
    assert re.match(r'line \d+: ', left_out.first)


@pytest.mark.parametrize('name', TABLES)
def test_a_quarter_of_bad_rows_is_too_many(tmp_path: Path, name: str) -> None:
    reader, _ = GOOD[name]
    rows = long_table(name)
    first = len(rows) - 10
    bad = [*rows[:first], *('x' for _ in rows[first:])]
    assert len(reader(written(tmp_path, *bad))) == 30
    bad[first - 1] = 'x'
    with pytest.raises(DataError, match=rf'positions\.csv, line {first}: .*expected.* \(11 of 40 rows are bad\)'):
        reader(written(tmp_path, *bad))


@pytest.mark.parametrize('name', ['oxford gps', 'radar utm', 'boreas'])
def test_a_header_in_the_middle_is_left_out(tmp_path: Path, name: str) -> None:
    reader, _ = GOOD[name]
    rows = long_table(name)
    trajectory = reader(written(tmp_path, *rows[:20], rows[0], *rows[20:]))
    assert len(trajectory) == 40
    assert trajectory.left_out[0].first.startswith('line 21: the header again')


@pytest.mark.parametrize('name', TABLES)
def test_a_separator_after_the_last_column_is_no_column(tmp_path: Path, name: str) -> None:
    reader, _ = GOOD[name]
    rows = long_table(name)
    end = ' ' if name == 'tum' else ','
    trajectory = reader(written(tmp_path, *(row + end if row[0].isdigit() else row for row in rows)))
    assert (len(trajectory), trajectory.left_out) == (40, ())


def test_a_last_line_cut_within_its_last_number_is_left_out(tmp_path: Path) -> None:
    rows = ['timestamp,altitude,latitude,longitude']
    rows += [f'{US + 200_000 * k},60.0,51.7600000,-1.2577{k:03d}' for k in range(40)]
    path = tmp_path / 'positions.csv'
    path.write_text('\n'.join(rows)[:-5])
    trajectory = read_oxford_gps(path)
    assert len(trajectory) == 39
    assert 'the file is cut off' in trajectory.left_out[0].first
    path.write_text('\n'.join(rows))
    assert len(read_oxford_gps(path)) == 40


@pytest.mark.parametrize(('separator', 'comma'), [(';', ','), (';', '.'), ('\t', '.')])
def test_other_separators_and_capitals(tmp_path: Path, separator: str, comma: str) -> None:
    rows = [GPS_HEADER.upper(), *(f'{US + 200_000 * k},7,51.76{k:03d},-1.2577,65.1,1' for k in range(5))]
    changed = [row.replace(',', separator).replace('.', comma) for row in rows]
    expected = read_oxford_gps(written(tmp_path, *rows))
    found = read_oxford_gps(written(tmp_path, *changed))
    assert found.positions.tolist() == expected.positions.tolist()
    assert expected.positions[4].tolist() == [51.76004, -1.2577, 65.1]


@pytest.mark.parametrize(
    ('header', 'found'),
    [
        ('time;lat;lon;alt', "found 'time;lat;lon;alt' separated by semicolons"),
        ('time,lat,lon,alt', "found 'time,lat,lon,alt' separated by commas"),
        ('PK\x03\x04', "found 'PK"),
    ],
)
def test_an_unknown_header_is_shown(tmp_path: Path, header: str, found: str) -> None:
    with pytest.raises(DataError, match='expected a header with timestamp, latitude') as error:
        read_oxford_gps(written(tmp_path, header, '1;2;3;4'))
    assert found in str(error.value)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    ('stamp', 'rounded_s'),
    [
        (lambda us: f'{us:.5E}', '10000'),
        (lambda us: f'{us:.9E}', '1'),
        (lambda us: f'{round(us, -10)}', '10000'),
        (lambda us: f'{us // 10**6}', '1'),
        (lambda us: f'{us / 1e6:.0f}.0', '1'),
    ],
)
def test_rounded_stamps_are_recognised(tmp_path: Path, stamp: Callable[[int], str], rounded_s: str) -> None:
    start = 1_547_131_046_353_776
    rows = [f'{stamp(start + 200_000 * k)},7,51.76{k:03d},-1.2577,65.1,1' for k in range(40)]
    with pytest.raises(DataError, match='expected every digit') as error:
        read_oxford_gps(written(tmp_path, GPS_HEADER, *rows))
    assert f'stamps are rounded to {rounded_s}' in str(error.value)


@pytest.mark.parametrize('stamp', [lambda us: f'{us:.17E}', lambda us: f'{us / 1e6:.1f}', lambda us: f'{us}'])
def test_stamps_with_enough_digits_are_exact(tmp_path: Path, stamp: Callable[[int], str]) -> None:
    start = 1_547_131_046_200_000
    rows = [f'{stamp(start + 200_000 * k)},7,51.76{k:03d},-1.2577,65.1,1' for k in range(40)]
    trajectory = read_oxford_gps(written(tmp_path, GPS_HEADER, *rows))
    assert set(np.diff(trajectory.stamps_ns).tolist()) == {200_000_000}


@pytest.mark.parametrize('cell', ['1\0', '1' * 70_000])
def test_a_line_is_damaged_though_its_positions_can_be_read(tmp_path: Path, cell: str) -> None:
    rows = [f'{US + 200_000 * k},7,51.76,-1.2577,65.1,1' for k in range(6)]
    rows[3] = rows[3][:-1] + cell
    tally: Counter[str] = Counter()
    assert len(read_oxford_gps(written(tmp_path, GPS_HEADER, *rows), tally)) == 5
    assert tally == {'damaged': 1}


def test_empty_cells_are_no_fix(tmp_path: Path) -> None:
    rows = [f'{US + 200_000 * k},7,51.76,-1.2577,65.1,1' for k in range(6)]
    rows[2:4] = [f'{US + 400_000},0,,,,', f'{US + 600_000},0,,,,']
    tally: Counter[str] = Counter()
    assert len(read_oxford_gps(written(tmp_path, GPS_HEADER, *rows), tally)) == 4
    assert tally == {'no_fix': 2}


@pytest.mark.parametrize('name', ['radar utm', 'boreas', 'global pose'])
def test_zeros_in_utm_are_no_fix(tmp_path: Path, name: str) -> None:
    reader, _ = GOOD[name]
    rows = long_table(name)
    columns = {'radar utm': (1, 2), 'boreas': (1, 2), 'global pose': (4, 8)}[name]
    cells = rows[20].split(',')
    for column in columns:
        cells[column] = '0'
    tally: Counter[str] = Counter()
    trajectory = reader(written(tmp_path, *rows[:20], ','.join(cells), *rows[21:]), tally)
    assert len(trajectory) == 39
    assert tally == {'no_fix': 1}


def test_a_fifo_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'positions.csv')
    with pytest.raises(DataError, match='not a regular file'):
        read_oxford_gps(tmp_path / 'positions.csv')


CELLS = st.one_of(
    st.integers(-(2**70), 2**70).map(str), st.floats().map(str), st.text(max_size=6), st.just(str(US)), st.just('51.5')
)


@given(rows=st.lists(st.lists(CELLS, min_size=1, max_size=14), max_size=4), name=st.sampled_from(sorted(GOOD)))
@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
def test_any_table_is_a_trajectory_or_one_line_of_error(tmp_path: Path, rows: list[list[str]], name: str) -> None:
    reader, lines = GOOD[name]
    header = lines[:1] if lines[0][0].isalpha() else []
    path = tmp_path / 'any.csv'
    path.write_text('\n'.join([*header, *(','.join(row) for row in rows)]), encoding='utf-8', errors='replace')
    try:
        trajectory = reader(path)
    except DataError as error:
        assert 'any.csv' in str(error)
    else:
        assert np.isfinite(trajectory.positions).all()
        assert np.all(np.diff(trajectory.stamps_ns) > 0)


def heading_errors(trajectory: Trajectory) -> NDArray[np.float64]:
    """Yaw less the driven direction, degrees, where the vehicle goes straight on for 2 s at over 2.5 m/s."""
    origin = trajectory.origin()
    metric = trajectory.in_frame(LocalFrame(origin) if origin else None)
    moved = metric.positions[8:, :2] - metric.positions[:-8, :2]
    turned = wrap_angle(metric.yaws_rad[8:] - metric.yaws_rad[:-8])
    straight = (np.hypot(*moved.T) > 5.0) & (np.abs(turned) < math.radians(1.0))
    apart = wrap_angle(metric.yaws_rad[4:-4] - np.arctan2(moved[:, 1], moved[:, 0]))
    return np.asarray(np.degrees(apart)[straight])


def assert_right(errors: NDArray[np.float64], mounted_deg: float) -> None:
    """Headings are right to a fraction of a degree, whatever way the sensor is mounted."""
    assert len(errors) > 500
    assert np.median(errors) == pytest.approx(mounted_deg, abs=0.05)
    assert np.percentile(np.abs(errors - mounted_deg), 90) < 0.3


@pytest.mark.parametrize('drive', ['boreas-2021-08-05-13-34', 'boreas-2021-09-02-11-42'])
def test_boreas_headings_are_the_driven_direction(real_data: Path, drive: str) -> None:
    assert_right(heading_errors(read_radar_poses(real_data / 'boreas' / f'{drive}.radar_poses.csv')), -0.14)


@pytest.mark.parametrize('number', [1, 2, 3])
def test_kaist_headings_are_the_driven_direction(real_data: Path, number: int) -> None:
    path = real_data / 'mulran_kaist03' / f'mulran_KAIST0{number}_radar_utm.csv'
    assert_right(heading_errors(read_radar_utm(path)), 0.0)


@pytest.mark.parametrize('drive', ['dcc01', 'dcc02', 'dcc03', 'kaist01', 'kaist02', 'kaist03'])
def test_tum_headings_are_those_of_a_radar_that_is_mounted_askew(real_data: Path, drive: str) -> None:
    # MulRan's radar is turned by 0.9° in its vehicle.
    assert_right(heading_errors(read_tum(real_data / 'worlds' / f'{drive}.tum')), 0.9)


def test_recorded_oxford_positions_agree_with_their_utm_columns(real_data: Path) -> None:
    path = real_data / 'oxford_tiny' / 'gps' / 'gps.csv'
    trajectory = read_oxford_gps(path)
    assert len(trajectory) == 2833
    northing, easting = np.loadtxt(path, delimiter=',', skiprows=1, usecols=(8, 9), unpack=True)
    utm = pyproj.Transformer.from_crs(4326, 32630, always_xy=True)
    e, n = utm.transform(trajectory.positions[:, 1], trajectory.positions[:, 0])
    assert np.abs(e - easting).max() < 0.2
    assert np.abs(n - northing).max() < 0.2


def test_recorded_radiate_positions(real_data: Path) -> None:
    tally: Counter[str] = Counter()
    trajectory = read_gps_twist(real_data / 'radiate_tiny_foggy' / 'GPS_IMU_Twist.txt', tally)
    assert len(trajectory) + sum(tally.values()) == 250
    assert tally['repeated_position_stamp'] == 117
    assert trajectory.positions[0] == pytest.approx([55.892359, -3.321674, 209.238], abs=1e-3)
    assert np.isnan(trajectory.yaws_rad).all()


def test_the_orientation_of_radiate_is_no_heading(real_data: Path) -> None:
    folder = real_data / 'radiate_tiny_foggy'
    trajectory = read_gps_twist(folder / 'GPS_IMU_Twist.txt')
    origin = trajectory.origin()
    assert origin is not None
    moved = np.diff(trajectory.in_frame(LocalFrame(origin)).positions[[0, -1], :2], axis=0)[0]
    lines = [(folder / 'GPS_IMU_Twist' / f'{number:06d}.txt').read_text().split('\n') for number in range(1, 251)]
    yaws = [yaw_of_quaternion(*(float(cell) for cell in sample[4].split(','))) for sample in lines]
    apart = np.degrees(wrap_angle(np.array(yaws) - math.atan2(moved[1], moved[0])))
    # It turns with the vehicle, but its zero is none: no convention is 54° off.
    assert np.median(apart) == pytest.approx(-54.0, abs=2.0)


@pytest.mark.parametrize('drive', ['kaist01', 'dcc03'])
def test_recorded_tum_traversals(real_data: Path, drive: str) -> None:
    trajectory = read_tum(real_data / 'worlds' / f'{drive}.tum')
    assert set(np.diff(trajectory.stamps_ns).tolist()) == {250_000_000}
    assert not trajectory.geodetic
