from __future__ import annotations

import dataclasses
import gzip
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from radar_images import read_image

from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.errors import DataError
from offradar_ros.geometry import Trajectory
from offradar_ros.recordings.datasets.check import Finding, Findings, check_folder
from offradar_ros.recordings.datasets.check.coverage import coverage
from offradar_ros.recordings.datasets.check.stamps import check_stamps
from offradar_ros.recordings.datasets.coverage import seconds_apart
from offradar_ros.recordings.datasets.listed_scans import listing_differences
from offradar_ros.recordings.datasets.registry import open_sequence

Writers = dict[str, Callable[..., Any]]


def texts(findings: Findings, level: str) -> list[str]:
    return [finding.text for finding in findings.findings if finding.level == level]


def only_problem(folder: Path, **options: Any) -> str:
    (problem,) = check_folder(folder, **options).problems
    return problem.text


def scans_of(folder: Path) -> list[Path]:
    return sorted((folder / 'radar').glob('*.png'))


def test_a_sound_folder(oxford_folder: Path) -> None:
    findings = check_folder(oxford_folder)
    assert (findings.path, findings.layout, findings.problems) == (oxford_folder, 'oxford', ())
    text = ' | '.join(texts(findings, 'ok'))
    for expected in (
        'oxford sequence 2019-01-10-14-36-48-radar-oxford-10k: 6 scans',
        '1.2 s at 4.00 scans a second',
        '6 scans of 400 azimuths × 3768 range bins of 0.0432 m',
        'stamp of the scan is that of its first row: 6 scans',
        'GPS (gps.csv): 20 positions, 5.0 a second',
        'gps.csv: 6 of 6 scans have a position',
    ):
        assert expected in text


def test_an_unrecognised_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match='no radar scans recognised'):
        check_folder(tmp_path)


@pytest.mark.parametrize('which', [0, 3])
def test_truncated_and_foreign_files(oxford_folder: Path, which: int) -> None:
    scan = scans_of(oxford_folder)[which]
    scan.write_bytes(scan.read_bytes()[:5000])
    assert only_problem(oxford_folder) == f'{scan}: truncated PNG, it ends after 5000 bytes'
    scan.write_bytes(b'GIF89a')
    assert only_problem(oxford_folder) == f'{scan}: not a PNG file'
    scan.write_bytes(b'version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n')
    assert only_problem(oxford_folder).startswith(f'{scan}: not a PNG file, but a pointer of Git LFS: git lfs pull')
    scan.write_bytes(b'\xff\xd8\xff\xe0')
    assert only_problem(oxford_folder) == f'{scan}: not a PNG file, but JPEG, which changes the power'
    scan.write_bytes(b'')
    assert only_problem(oxford_folder) == f'{scan}: empty file, expected a PNG'


def test_files_that_are_damaged_alike_are_one_line(oxford_folder: Path) -> None:
    scans = scans_of(oxford_folder)
    for k, scan in enumerate(scans[1:]):
        scan.write_bytes(scan.read_bytes()[: 5000 + k])
    assert only_problem(oxford_folder) == (
        f'{scans[1]}: truncated PNG, it ends after 5000 bytes (and 4 scans like it: {scans[2].name}, {scans[3].name}, '
        f'{scans[4].name} and 1 more)'
    )


def test_a_scan_that_is_there_again_is_told_of(oxford_folder: Path) -> None:
    """With a stamp of its own, as a driver sends it that repeats the last one."""
    first, second = scans_of(oxford_folder)[2:4]
    image = read_image(first)
    repeated = np.concatenate([read_image(second)[:, :11], image[:, 11:]], axis=1)
    cv2.imwrite(str(second), repeated)
    assert only_problem(oxford_folder) == (
        '1 scan with the very power of the one before, which no radar measures: the driver or the recording repeats it '
        f'({second.name})'
    )


def test_files_that_were_numbered_anew_are_read_with_their_positions(oxford_folder: Path) -> None:
    for number, scan in enumerate(scans_of(oxford_folder)):
        scan.rename(scan.with_name(f'{number:06d}.png'))
    findings = check_folder(oxford_folder)
    assert (findings.layout, findings.problems) == ('oxford', ())
    assert any('6 of 6 scans have a position' in finding.text for finding in findings.findings)


@pytest.mark.parametrize('encoding', ['utf-8-sig', 'utf-16', 'utf-16-le', 'utf-16-be'])
def test_lists_and_tables_of_windows_are_read(oxford_folder: Path, encoding: str) -> None:
    mark = {'utf-16-le': '\ufeff', 'utf-16-be': '\ufeff'}.get(encoding, '')
    for path in (oxford_folder / 'radar.timestamps', oxford_folder / 'gps' / 'gps.csv'):
        path.write_bytes((mark + path.read_text().replace('\n', '\r\n')).encode(encoding))
    assert check_folder(oxford_folder).problems == ()


def test_a_table_that_is_no_text_is_refused_as_such(oxford_folder: Path) -> None:
    table = oxford_folder / 'gps' / 'gps.csv'
    table.write_bytes(gzip.compress(table.read_bytes()))
    assert only_problem(oxford_folder).startswith(f'{table}, line 1: expected ')
    assert '\\x' not in only_problem(oxford_folder)


def test_scans_missing_from_disk_and_from_the_list(oxford_folder: Path) -> None:
    scans = scans_of(oxford_folder)
    scans[1].unlink()
    listing = oxford_folder / 'radar.timestamps'
    listing.write_text(listing.read_text().replace(f'{scans[5].stem} 1\n', ''))
    problems = ' | '.join(finding.text for finding in check_folder(oxford_folder).problems)
    assert f'1 of 5 listed scans have no file, first {scans[1].name}' in problems
    assert f'1 of 5 files are not listed, first {scans[5].name}' in problems
    assert '1 gap between scans, the longest 0.50 s after scan 0' in problems


@pytest.mark.parametrize(
    ('text', 'expected'),
    [('hello 1\n', 'line 1: expected "<stamp> <valid>"'), ('', '6 of 6 files are not listed'), ('\xff\n', 'line 1')],
)
def test_a_damaged_list(oxford_folder: Path, text: str, expected: str) -> None:
    (oxford_folder / 'radar.timestamps').write_text(text)
    assert expected in only_problem(oxford_folder)


def test_a_list_that_repeats_and_goes_back(oxford_folder: Path) -> None:
    listing = oxford_folder / 'radar.timestamps'
    lines = listing.read_text().splitlines()
    listing.write_text('\n'.join([lines[1], lines[0], *lines[2:], lines[5]]))
    problems = [finding.text for finding in check_folder(oxford_folder).problems]
    assert any('stamps that go backwards: 1' in text for text in problems)
    assert any('stamps listed more than once: 1' in text for text in problems)


def test_a_list_is_not_gone_through_for_each_of_its_scans() -> None:
    class Listed(list[int]):
        times = 0

        def __iter__(self) -> Iterator[int]:
            self.times += 1
            return super().__iter__()

    listed = Listed(range(10**18, 10**18 + 9))
    files = [Path(f'{stamp_ns}.png') for stamp_ns in listed[1:]]
    (text,) = listing_differences(Path('list'), listed, files, unit_ns=1)
    assert text == f'list: 1 of 9 listed scans have no file, first {10**18}.png'
    assert listed.times < 5


def test_odd_sizes_empty_scans_and_wrong_stamps(oxford_folder: Path, scan_writers: Writers) -> None:
    scans = scans_of(oxford_folder)
    stamps = [int(scan.stem) * 1000 for scan in scans]
    make, write, metadata = (scan_writers[name] for name in ('scan', 'png', 'metadata'))
    write(scans[1], metadata(make(stamps[1], 3360), microseconds=True))
    silent = metadata(make(stamps[2]), microseconds=True)
    silent[:, 11:] = 0
    write(scans[2], silent)
    write(scans[3], metadata(make(stamps[0]), microseconds=True))
    partial = metadata(make(stamps[4]), microseconds=True)
    partial[:100] = 0
    write(scans[4], partial)
    write(scans[5], make(stamps[5], 3779).power)
    problems = {finding.text for finding in check_folder(oxford_folder).problems}
    assert problems == {
        f'odd size: 1 scan of 400 azimuths × 3360 range bins of 0.0595238 m, first {scans[1].name}',
        f'no signal, every power value is zero, or the same: 1 scan ({scans[2].name})',
        f'stamp of the scan is not within the stamps of its rows: 1 scan ({scans[3].name})',
        f'azimuths without any power (partial rotation): 1 scan ({scans[4].name})',
        'rows without the metadata columns that this layout has: read another layout (--layout), or set '
        'radar.metadata_columns to 0 if all bytes are power, or radar.row_angles to equal if the first 11 are not: '
        f'1 scan ({scans[5].name})',
    }


def test_encoder_irregularities(oxford_folder: Path, scan_writers: Writers) -> None:
    scans = scans_of(oxford_folder)
    image = scan_writers['metadata'](scan_writers['scan'](int(scans[0].stem) * 1000), microseconds=True)
    scan_writers['png'](scans[0], np.delete(image, 200, axis=0))
    twice = image.copy()
    twice[200, 8:10] = twice[199, 8:10]
    scan_writers['png'](scans[1].with_name(scans[0].name), twice)
    texts_of_twice = [finding.text for finding in check_folder(oxford_folder).problems]
    assert any(text.startswith('encoder counts that contradict the others') for text in texts_of_twice)
    scan_writers['png'](scans[0], np.delete(image, 200, axis=0))
    problems = [finding.text for finding in check_folder(oxford_folder).problems]
    assert f'azimuths missing from the rotation: 1 scan ({scans[0].name})' in problems
    assert any(text.startswith('odd size: 1 scan of 399 azimuths') for text in problems)
    back = image.copy()
    back[[10, 11], :8] = back[[11, 10], :8]
    scan_writers['png'](scans[0], back)
    assert 'row stamps that contradict the others, interpolated: 1 scan' in only_problem(oxford_folder)


def test_a_sample_decodes_only_some(oxford_folder: Path) -> None:
    scan = scans_of(oxford_folder)[1]
    scan.write_bytes(b'')
    findings = check_folder(oxford_folder, sample=2)
    assert findings.problems == ()
    assert '2 of 6 scans decoded' in texts(findings, 'note')
    assert check_folder(oxford_folder, sample=100).problems


def test_the_same_refusal_of_many_scans_is_one_problem(oxford_folder: Path) -> None:
    radar = RadarConfig(profile='custom')
    assert only_problem(oxford_folder, radar=radar).startswith('radar.profile is custom; set radar.range_resolution_m')
    assert ': 6 scans (' in only_problem(oxford_folder, radar=radar)


def test_progress_counts_the_scans(oxford_folder: Path) -> None:
    seen: list[tuple[int, int]] = []
    check_folder(oxford_folder, sample=4, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_position_files_are_all_reported(oxford_folder: Path) -> None:
    gps = oxford_folder / 'gps' / 'gps.csv'
    lines = gps.read_text().splitlines()
    lines[3] = lines[3].split(',')[0] + ',0,0,0'
    lines.insert(9, lines[8])
    gps.write_text('\n'.join(lines))
    start_us = 1_547_131_045_000_000
    statuses = ['INS_ALIGNING'] * 2 + ['INS_SOLUTION_GOOD'] * 3
    rows = [f'{start_us + 200_000 * k},{status},51.76,-1.26,65,0.1' for k, status in enumerate(statuses)]
    header = 'timestamp,ins_status,latitude,longitude,altitude,yaw'
    (oxford_folder / 'gps' / 'ins.csv').write_text('\n'.join([header, *rows]))
    findings = check_folder(oxford_folder)
    assert 'INS (ins.csv): 2 rows left out: status INS_ALIGNING' in texts(findings, 'problem')
    assert any('GPS (gps.csv): 1 row left out: without fix (line 4: ' in text for text in texts(findings, 'problem'))
    assert any('GPS (gps.csv): 1 row left out: repeated stamp (line 10: ' in text for text in texts(findings, 'note'))
    assert any(text.startswith('gps.csv: 6 of 6 scans') for text in texts(findings, 'ok'))


def test_a_damaged_position_file_is_a_finding(oxford_folder: Path) -> None:
    gps = oxford_folder / 'gps' / 'gps.csv'
    gps.write_text(gps.read_text().replace('latitude', 'lat'))
    assert 'gps.csv, line 1: no column latitude' in only_problem(oxford_folder)


def test_gaps_between_positions(oxford_folder: Path) -> None:
    gps = oxford_folder / 'gps' / 'gps.csv'
    lines = gps.read_text().splitlines()
    gps.write_text('\n'.join([*lines[:8], *lines[11:]]))
    assert check_folder(oxford_folder).problems == ()
    findings = check_folder(oxford_folder, position=PositionConfig(max_gap_s=0.5))
    assert 'of 6 scans have a position (gaps up to 0.5 s)' in findings.problems[0].text
    assert 'GPS (gps.csv): 1 gap over 0.5 s, the longest 0.8 s' in texts(findings, 'note')


def test_no_positions_is_a_note(oxford_folder: Path) -> None:
    (oxford_folder / 'gps' / 'gps.csv').unlink()
    findings = check_folder(oxford_folder)
    assert findings.problems == ()
    assert any(text.startswith('no positions') for text in texts(findings, 'note'))


@pytest.mark.parametrize(('first', 'last', 'seconds'), [(0, 5, 5.0), (25, 30, 5.0), (5, 15, 0.0)])
def test_scans_before_and_after_the_positions(first: int, last: int, seconds: float) -> None:
    trajectory = Trajectory(np.array([10, 20]) * 10**9, np.zeros((2, 3)), np.full(2, np.nan), geodetic=False)
    assert seconds_apart(np.array([first, last]) * 10**9, trajectory) == seconds


@pytest.mark.parametrize('which', [slice(0, 1), slice(9, 10), slice(19, 20), slice(0, 3), slice(17, 20)])
@pytest.mark.parametrize('by_s', [-1_700_000_000, -172_800, 100_000_000])
def test_a_few_scans_of_a_clock_not_yet_set_do_not_count_as_the_first_or_last(which: slice, by_s: int) -> None:
    """In the order in which they are recorded."""
    stamps_ns = 1_700_000_000 * 10**9 + np.arange(20) * 250_000_000
    known = stamps_ns[0] - 10**9 + np.arange(80) * 10**8
    stamps_ns[which] += by_s * 10**9
    trajectory = Trajectory(known, np.zeros((80, 3)), np.full(80, np.nan), geodetic=False)
    odd = which.stop - which.start
    assert coverage('gps', stamps_ns, trajectory, PositionConfig()) == Finding(
        'problem', f'gps: {20 - odd} of 20 scans have a position (gaps up to 1.5 s)'
    )
    apart = dataclasses.replace(trajectory, stamps_ns=known + 37 * 10**9)
    text = coverage('gps', stamps_ns, apart, PositionConfig()).text
    assert text.endswith('TAI is 37 s ahead of UTC: offradar convert --position-offset-s -37.0)')
    assert seconds_apart(stamps_ns, trajectory) == 0.0
    duration_s = float(next(check_stamps(stamps_ns)).text.partition(' s at ')[0])
    assert 4.75 - 0.25 * odd <= duration_s <= 4.8
    assert not [finding for finding in check_stamps(stamps_ns) if finding.level == 'note']


@pytest.mark.parametrize('order', [slice(None), slice(None, None, -1)])
def test_one_scan_with_a_position_is_told_of_though_the_others_are_apart(order: slice) -> None:
    stamps_ns = (10**18 + np.array([0, 5 * 86400, 5 * 86400 + 1, 5 * 86400 + 2]) * 10**9)[order]
    known = 10**18 + np.array([-1, 1]) * 500_000_000
    trajectory = Trajectory(known, np.zeros((2, 3)), np.full(2, np.nan), geodetic=False)
    assert coverage('gps', stamps_ns, trajectory, PositionConfig()).text.startswith('gps: 1 of 4 scans have a position')


def test_foggy_positions_start_after_the_last_scan(real_data: Path) -> None:
    findings = check_folder(real_data / 'radiate_tiny_foggy')
    problems = [finding.text for finding in findings.problems]
    assert (
        'GPS_IMU_Twist.txt: no scan has a position: positions start 59.8 s after the last scan '
        '(if the clocks disagree: offradar convert --position-offset-s -64.1)'
    ) in problems
    assert '18 scans of 400 azimuths × 576 range bins of 0.1736 m' in texts(findings, 'ok')


def test_positions_of_other_days_are_notes(real_data: Path) -> None:
    findings = check_folder(real_data / 'mulran_kaist03')
    others = [text for text in texts(findings, 'note') if text.endswith('not of this drive')]
    assert [text.split(':')[0] for text in others] == [
        'mulran_KAIST01_radar_utm.csv',
        'mulran_KAIST02_radar_utm.csv',
    ]
    assert others[0].split(': ')[1] == '74.2 days from the scans at the nearest'
    (apart,) = [f.text for f in findings.problems if 'no scan has a position' in f.text]
    assert apart.startswith('mulran_KAIST03_radar_utm.csv: ')


@given(
    length_ns=st.integers(1, 10**11),
    later_ns=st.integers(1, 10**12),
    early=st.booleans(),
)
@settings(max_examples=100, deadline=None)
def test_the_proposed_offset_brings_both_together(length_ns: int, later_ns: int, early: bool) -> None:
    """Scans over 1 s, positions for longer, apart by `later_ns`."""
    scans = 10**18 + np.arange(5) * 250_000_000
    known = np.arange(0, 10**9 + length_ns + 3 * 10**8, 10**8)
    known += scans[0] - known[-1] - later_ns if early else scans[-1] + later_ns
    trajectory = Trajectory(known, np.zeros((len(known), 3)), np.full(len(known), np.nan), geodetic=False)
    text = coverage('gps', scans, trajectory, PositionConfig()).text
    assert f'positions {"end" if early else "start"} ' in text
    offset_s = float(text.rpartition(' ')[2].rstrip(')'))
    moved = dataclasses.replace(trajectory, stamps_ns=known + round(offset_s * 1e9))
    assert (
        coverage('gps', scans, moved, PositionConfig()).text == 'gps: 5 of 5 scans have a position (gaps up to 1.5 s)'
    )


@pytest.mark.parametrize(
    ('away_s', 'why', 'option'),
    [
        (3600.0, ', as time zones do: ', '-3600.0'),
        (-8 * 3600.0, ', as time zones do: ', '28800.0'),
        (-5.5 * 3600.0, ', as time zones do: ', '19800.0'),
        (-1024 * 7 * 86400.0, ', a GPS week number that has rolled over: 1024 weeks: ', '619315200.0'),
        (-315_964_782.0, ', GPS time counts from 1980, and is 18 s ahead of UTC: ', '315964782.0'),
        (37.0, ', TAI is 37 s ahead of UTC: ', '-37.0'),
        (5000.0, ': ', '-4998.0'),
    ],
)
def test_an_offset_that_clocks_usually_have_is_proposed_exactly(away_s: float, why: str, option: str) -> None:
    """Positions from 2 s before the scans to 2 s after them, on another clock."""
    scans = 1_700_000_000 * 10**9 + np.arange(40) * 250_000_000
    known = scans[0] - 2 * 10**9 + np.arange(140) * 10**8 + round(away_s * 1e9)
    trajectory = Trajectory(known, np.zeros((140, 3)), np.full(140, np.nan), geodetic=False)
    text = coverage('gps', scans, trajectory, PositionConfig()).text
    assert text.endswith(f'(if the clocks disagree{why}offradar convert --position-offset-s {option})')


def test_an_offset_already_given_is_part_of_the_proposed_one() -> None:
    known = np.array([100, 110]) * 10**9
    trajectory = Trajectory(known, np.zeros((2, 3)), np.full(2, np.nan), geodetic=False)
    text = coverage('gps', np.array([10, 20]) * 10**9, trajectory, PositionConfig(), offset_s=7.0).text
    assert text.endswith('--position-offset-s -83.0)')
    unset = dataclasses.replace(trajectory, stamps_ns=known * 2 * 10**7)
    text = coverage('gps', np.array([10, 20]) * 10**9, unset, PositionConfig()).text
    assert text.endswith('positions start 23148.1 days after the last scan')
    nothing = dataclasses.replace(trajectory, stamps_ns=known[:0], positions=np.zeros((0, 3)), yaws_rad=np.zeros(0))
    assert coverage('gps', known, nothing, PositionConfig()).level == 'problem'


def test_the_recorded_oxford_folder_is_sound(real_data: Path) -> None:
    assert check_folder(real_data / 'oxford_tiny').problems == ()
    assert open_sequence(real_data / 'oxford_tiny').stamps_ns[0] == 1_547_131_046_353_776_000


def test_a_scan_that_is_there_twice_is_named(oxford_folder: Path) -> None:
    scans = scans_of(oxford_folder)
    twin = scans[3].with_name(f'{int(scans[3].stem) + 1}.png')
    twin.write_bytes(scans[3].read_bytes())
    (oxford_folder / 'radar.timestamps').unlink()
    text, _ = (problem.text for problem in check_folder(oxford_folder).problems)
    assert text.startswith('1 scan less than a quarter of a period after the one before')
    assert f'First {twin.name}, 0.001 ms after {scans[3].name}' in text


@pytest.mark.parametrize(('share', 'twins'), [(0.02, True), (0.2, True), (0.3, False), (0.7, False)])
def test_twins_are_those_within_a_quarter_of_a_period(share: float, twins: bool) -> None:
    stamps_ns = 10**18 + np.arange(20) * 250_000_000
    stamps_ns = np.insert(stamps_ns, 8, stamps_ns[7] + round(share * 250_000_000))
    found = [finding.text for finding in check_stamps(stamps_ns) if finding.level == 'problem']
    assert any('there twice' in text for text in found) == twins


def test_row_stamps_of_a_clock_never_set(oxford_folder: Path, scan_writers: Writers) -> None:
    for file in scans_of(oxford_folder):
        image = scan_writers['metadata'](scan_writers['scan'](int(file.stem) * 1000), microseconds=True)
        image[:, :8] = (900_000_000 + np.arange(400) * 625).astype('<i8').reshape(-1, 1).view(np.uint8)
        scan_writers['png'](file, image)
    text = only_problem(oxford_folder)
    assert text.startswith('row stamps of a clock that was never set')


def test_scan_stamps_that_count_from_a_start_are_noted() -> None:
    found = [finding.text for finding in check_stamps(np.arange(20) * 250_000_000) if finding.level == 'note']
    assert found == ['stamps count from a start, not from 1970: simulated time, or a clock that was never set']


def test_scan_stamps_that_no_message_can_hold_are_a_problem(oxford_folder: Path) -> None:
    for at, file in enumerate(scans_of(oxford_folder)[2:]):
        file.rename(file.with_name(f'{2_524_608_000_000_000 + 250_000 * at}.png'))
    (oxford_folder / 'radar.timestamps').unlink()
    problems = [problem.text for problem in check_folder(oxford_folder).problems]
    (text,) = [text for text in problems if 'which no message can hold' in text]
    assert text.startswith(
        'a stamp before 1970, or from 2038 on, which no message can hold: 4 scans (2524608000000000.png'
    )
