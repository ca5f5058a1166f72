from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest


def lines(ran: Any) -> list[tuple[str, str]]:
    """Level and text of each finding."""
    return [(line[:8].strip(), line[8:]) for line in ran.out.splitlines()]


def test_a_sound_recording(offradar: Callable[..., Any], real_data: Path) -> None:
    ran = offradar('check', real_data / 'oxford_tiny')
    assert ran.status == 0
    assert {level for level, _ in lines(ran)} == {'ok'}
    assert ('ok', '11 scans of 400 azimuths × 3768 range bins of 0.0432 m') in lines(ran)


@pytest.mark.parametrize(
    ('folder', 'said'),
    [
        ('mulran_kaist03', '3 scans of 400 azimuths × 3360 range bins of 0.0595238 m'),
        ('mulran_ray', '1 scan of 400 azimuths × 3360 range bins of 0.0595238 m'),
        ('utias_frame', '1 scan of 400 azimuths × 6848 range bins'),
    ],
)
def test_recordings_of_other_layouts(offradar: Callable[..., Any], real_data: Path, folder: str, said: str) -> None:
    assert said in offradar('check', real_data / folder).out


def test_what_is_wrong_with_a_recording_is_a_problem_and_status_1(
    offradar: Callable[..., Any], real_data: Path
) -> None:
    ran = offradar('check', real_data / 'radiate_tiny_foggy')
    assert ran.status == 1
    problems = [text for level, text in lines(ran) if level == 'problem']
    assert 'GPS_IMU_Twist.txt: no scan has a position: positions start 59.8 s after the last scan' in problems
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
    assert ('ok', '4 scans of 400 azimuths × 576 range bins') in lines(ran)
    assert ('ok', '/gps/fix: 100% of the scans have a position within gaps of 1.5 s') in lines(ran)


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


def test_names_with_brackets_and_braces_are_printed_as_they_are(
    offradar: Callable[..., Any], radiate_folder: Path
) -> None:
    odd = radiate_folder.parent / 'a{b}[/c]' / 'd[red]{}'
    shutil.copytree(radiate_folder, odd)
    assert 'radiate sequence d[red]{}: 5 scans' in offradar('check', odd).out
