from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from offradar_ros.recordings.bags.writer import write_bag


def lines(ran: Any) -> list[tuple[str, str]]:
    """Level and text of each finding."""
    return [(line[:8].strip(), line[8:]) for line in ran.out.splitlines()]


def test_a_sound_recording(offradar: Callable[..., Any], real_data: Path) -> None:
    ran = offradar('check', real_data / 'oxford_tiny')
    assert ran.status == 0
    assert {level for level, _ in lines(ran)} == {'ok'}
    assert ('ok', '11 scans of 400 azimuths × 3768 range bins of 0.0432 m') in lines(ran)


@pytest.mark.parametrize(
    ('folder', 'expected'),
    [
        ('mulran_kaist03', '3 scans of 400 azimuths × 3360 range bins of 0.0595238 m'),
        ('mulran_ray', '1 scan of 400 azimuths × 3360 range bins of 0.0595238 m'),
        ('utias_frame', '1 scan of 400 azimuths × 6848 range bins'),
    ],
)
def test_recordings_of_other_layouts(offradar: Callable[..., Any], real_data: Path, folder: str, expected: str) -> None:
    assert expected in offradar('check', real_data / folder).out


def test_a_problem_of_a_recording_is_reported_with_status_1(offradar: Callable[..., Any], real_data: Path) -> None:
    ran = offradar('check', real_data / 'radiate_tiny_foggy')
    assert ran.status == 1
    problems = [text for level, text in lines(ran) if level == 'problem']
    assert any('no scan has a position: positions start 59.8 s after the last scan' in text for text in problems)
    assert ('ok', '18 scans of 400 azimuths × 576 range bins of 0.1736 m') in lines(ran)


def test_every_damaged_scan_is_found(offradar: Callable[..., Any], radiate_folder: Path) -> None:
    cut, black = (radiate_folder / 'Navtech_Polar' / f'{frame:06d}.png' for frame in (2, 4))
    cut.write_bytes(cut.read_bytes()[:1000])
    cv2.imwrite(str(black), np.zeros((576, 400), np.uint8))
    ran = offradar('check', radiate_folder)
    assert ran.status == 1
    problems = [text for level, text in lines(ran) if level == 'problem']
    assert any(str(cut) in text and 'truncated' in text for text in problems)
    assert any(black.name in text and 'zero' in text for text in problems), problems


def test_a_sample_decodes_fewer(offradar: Callable[..., Any], radiate_folder: Path) -> None:
    assert '2 scans of 400 azimuths' in offradar('check', radiate_folder, '--sample', '2').out


def test_a_bag(offradar: Callable[..., Any], street_bag: Callable[..., Path]) -> None:
    ran = offradar('check', street_bag('bag', count=4))
    assert ran.status == 0
    assert ('ok', '4 scans of 400 azimuths × 576 range bins of 0.1736 m') in lines(ran)
    assert ('ok', '/gps/fix: 4 of 4 scans have a position (gaps up to 1.5 s)') in lines(ran)


def test_a_bag_whose_clocks_disagree(offradar: Callable[..., Any], street: Callable[..., Any], tmp_path: Path) -> None:
    drive = street(count=4)
    early = dataclasses.replace(drive.trajectory, stamps_ns=drive.trajectory.stamps_ns - 4 * 10**9)
    ran = offradar('check', write_bag(drive.with_trajectory(early), tmp_path / 'bag'))
    assert ran.status == 1
    problems = [text for level, text in lines(ran) if level == 'problem']
    # Positions last from 5 s before the first scan to 2.2 s before it.
    assert (
        '/gps/fix: no scan has a position: positions end 2.2 s before the first scan '
        '(if the clocks disagree: offradar convert --position-offset-s 5.0)'
    ) in problems


def test_the_radar_is_read_with_the_given_parameters(
    offradar: Callable[..., Any], street_bag: Callable[..., Path], radiate_folder: Path, tmp_path: Path
) -> None:
    params = tmp_path / 'params.yaml'
    params.write_text('radar: {range_resolution_m: 0.25}\nposition: {max_gap_s: 0.1}\n')
    for source in (street_bag('bag', count=4), radiate_folder):
        ran = offradar('check', source, '--params', params)
        assert 'range bins of 0.25 m' in ran.out
        assert 'gap' in ran.out
    params.write_text('radar: {profile: custom}\n')
    ran = offradar('check', tmp_path / 'bag', '--params', params)
    assert 'problem 4 scans would be refused (unknown_range_resolution): ' in ran.out


def test_a_truncated_bag_is_an_error(refused: Callable[..., str], street_bag: Callable[..., Path]) -> None:
    bag = street_bag('bag', count=4)
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-1000])
    assert f'{bag}: not a readable rosbag2 recording' in refused('check', bag)


def test_a_recording_that_was_cut_off_is_an_error(refused: Callable[..., str], street_bag: Callable[..., Path]) -> None:
    bag = street_bag('bag', count=2)
    (bag / 'metadata.yaml').unlink()
    assert 'no metadata.yaml' in refused('check', bag)


def test_what_is_no_recording_is_an_error(refused: Callable[..., str], tmp_path: Path, radiate_folder: Path) -> None:
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'letter.txt').write_text('Dear all')
    (tmp_path / 'letter.mcap').write_text('Dear all')
    assert 'no such folder' in refused('check', tmp_path / 'nothing')
    assert 'no radar scans recognised' in refused('check', tmp_path / 'empty')
    assert 'not a folder' in refused('check', tmp_path / 'letter.txt')
    assert 'not a readable rosbag2 recording' in refused('check', tmp_path / 'letter.mcap')
    assert "layout 'kitti' is unknown: expected auto, radiate" in refused('check', radiate_folder, '--layout', 'kitti')
    assert 'looked for radar/<µs>.png' in refused('check', radiate_folder, '--layout', 'oxford')


@pytest.mark.parametrize('command', ['check', 'convert', 'calibrate'])
def test_for_a_folder_of_recordings_these_are_named(
    refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path, command: str
) -> None:
    (tmp_path / 'bags').mkdir()
    all_options: dict[str, list[object]] = {
        'check': [],
        'convert': [tmp_path / 'out'],
        'calibrate': ['--out', tmp_path / 'out'],
    }
    options = all_options[command]

    def suggestion() -> str:
        return refused(command, tmp_path / 'bags', *options).partition('no radar scans recognised: ')[2]

    assert len(suggestion()) < 150
    (tmp_path / 'bags' / 'notes').mkdir()
    street_bag('bags/session_1', count=2)
    assert suggestion() == f'did you mean {tmp_path}/bags/session_1?'
    if command != 'calibrate':
        # What they do with several is tested elsewhere.
        return
    street_bag('bags/session_2', count=2)
    assert suggestion() == f'did you mean {tmp_path}/bags/session_1 or {tmp_path}/bags/session_2?'
    for number in range(3, 6):
        street_bag(f'bags/session_{number}', count=2)
    assert suggestion().endswith('session_3? (or one of 2 others)')


def test_for_a_folder_of_data_sets_these_are_named(refused: Callable[..., str], radiate_folder: Path) -> None:
    assert f'did you mean {radiate_folder}?' in refused('check', radiate_folder.parent)


def test_names_with_brackets_and_braces_are_printed_as_they_are(
    offradar: Callable[..., Any], radiate_folder: Path
) -> None:
    odd = radiate_folder.parent / 'a{b}[/c]' / 'd[red]{}'
    shutil.copytree(radiate_folder, odd)
    assert 'radiate sequence d[red]{}: 5 scans' in offradar('check', odd).out
