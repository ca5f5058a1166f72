"""`offradar check` of a whole data set."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from offradar_ros.recordings.datasets.oxford_writer import write_oxford

SPLIT = """
name: street
title: Street
source: made for this test
test: [friday, saturday]
train: [monday, tuesday]
"""


@pytest.fixture
def data_set(tmp_path: Path, street: Callable[..., Any]) -> Path:
    """Three drives of one street as Oxford folders, a folder of something else, and a split that names a fourth."""
    for number, name in enumerate(('friday', 'monday', 'tuesday')):
        drive = street(count=6, lane_m=float(number), noise_seed=number)
        folder = write_oxford(drive, tmp_path / 'data' / name)
        # No heading is known, so the INS has nothing.
        (folder / 'gps' / 'ins.csv').unlink()
    (tmp_path / 'data' / 'calibration').mkdir()
    (tmp_path / 'street.yaml').write_text(SPLIT)
    return tmp_path / 'data'


def sections(out: str) -> dict[str, list[tuple[str, str]]]:
    """Level and text of each finding, under each heading."""
    found = {}
    for block in out.strip().split('\n\n')[:-1]:
        heading, *lines = block.splitlines()
        found[heading] = [(line[:8].strip(), line[8:]) for line in lines]
    return found


@pytest.mark.parametrize('processes', [1, 2])
def test_a_sound_data_set(done: Callable[..., str], data_set: Path, processes: int) -> None:
    printed = done('check', data_set, '--processes', processes)
    found = sections(printed)
    assert list(found) == ['friday', 'monday', 'tuesday', 'all 3 sequences']
    for name in ('friday', 'monday', 'tuesday'):
        assert {level for level, _ in found[name]} == {'ok'}
        assert ('ok', 'gps.csv: 6 of 6 scans have a position (gaps up to 1.5 s)') in found[name]
    levels = [level for level, _ in found['all 3 sequences']]
    assert levels == ['note', 'ok', 'ok', 'ok']
    assert found['all 3 sequences'][0] == ('note', 'no radar scans recognised in calibration')
    assert printed.endswith('\nno problems\n')


def test_each_sequence_is_checked_as_if_it_were_alone(
    done: Callable[..., str], offradar: Callable[..., Any], data_set: Path
) -> None:
    scans = sorted((data_set / 'monday' / 'radar').glob('*.png'))
    scans[1].unlink()
    scans[2].write_bytes(b'')
    together, alone = offradar('check', data_set), offradar('check', data_set / 'monday')
    assert (together.status, alone.status) == (1, 1)
    findings = sections(together.out)
    assert findings['monday'] == [(line[:8].strip(), line[8:]) for line in alone.out.splitlines()]
    assert [level for level, _ in findings['monday']].count('problem') == 3
    assert together.out.endswith('\nproblems: monday\n')
    # Neither is the scan that is sampled.
    assert done('check', data_set / 'friday', '--sample', 1)
    assert offradar('check', data_set, '--sample', 1).out.count('1 of 6 scans decoded') == 2


def test_a_sequence_that_cannot_be_opened_does_not_stop_the_others(
    offradar: Callable[..., Any], data_set: Path, radiate_folder: Path
) -> None:
    moved = radiate_folder.rename(data_set / 'zoo')
    (moved / 'Navtech_Polar.txt').write_text('hello\n')
    ran = offradar('check', data_set)
    found = sections(ran.out)
    assert [level for level, _ in found['zoo']] == ['problem']
    assert 'Navtech_Polar.txt, line 1: expected "Frame: ' in found['zoo'][0][1]
    assert ('note', 'no scan has a position, so not compared: zoo') in found['all 4 sequences']
    assert (ran.status, len(found)) == (1, 5)


def test_bags_and_folders_are_compared_with_each_other(
    done: Callable[..., str], data_set: Path, street_bag: Callable[..., Path], offradar: Callable[..., Any]
) -> None:
    street_bag('wednesday', count=6).rename(data_set / 'wednesday')
    across = dict(sections(done('check', data_set)))['all 4 sequences']
    assert len([text for level, text in across if level == 'ok' and '100%' in text]) == 4
    (data_set / 'wednesday' / 'metadata.yaml').unlink()
    assert 'no metadata.yaml' in sections(offradar('check', data_set).out)['wednesday'][0][1]


def test_a_data_set_is_compared_with_a_split(offradar: Callable[..., Any], data_set: Path, tmp_path: Path) -> None:
    ran = offradar('check', data_set, '--split', tmp_path / 'street.yaml')
    assert ran.status == 1
    assert sections(ran.out)['split street'] == [
        ('problem', '1 of 2 test sequences are missing: saturday'),
        ('ok', 'all 2 training sequences are there'),
        ('ok', 'friday: 6 of 6 scans tested'),
        ('ok', 'monday: 6 of 6 scans usable for training'),
        ('ok', 'tuesday: 6 of 6 scans usable for training'),
    ]
    assert ran.out.endswith('\nproblems: split street\n')


def test_a_single_sequence_is_compared_with_a_split(
    offradar: Callable[..., Any], street: Callable[..., Any], tmp_path: Path
) -> None:
    write_oxford(street(count=2), tmp_path / 'data' / 'friday')
    (tmp_path / 'street.yaml').write_text(SPLIT)
    found = sections(offradar('check', tmp_path / 'data', '--split', tmp_path / 'street.yaml').out)
    assert ('problem', '2 of 2 training sequences are missing: monday, tuesday') in found['split street']


def test_a_split_needs_a_folder_of_sequences(refused: Callable[..., str], data_set: Path) -> None:
    assert '--split: expected a folder of sequences, got ' in refused('check', data_set / 'monday', '--split', 'oxford')
    assert 'oxfrod: expected a YAML file or one of the splits' in refused('check', data_set, '--split', 'oxfrod')


def test_the_layout_applies_to_every_sequence(done: Callable[..., str], data_set: Path) -> None:
    assert done('check', data_set, '--layout', 'boreas').count('boreas sequence ') == 3


def test_a_folder_that_may_not_be_read_is_ignored(
    offradar: Callable[..., Any], refused: Callable[..., str], data_set: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (data_set / 'lost+found').mkdir()
    barred = {data_set / 'lost+found'}
    listed = Path.iterdir

    def iterdir(path: Path) -> Any:
        if path in barred:
            raise PermissionError(13, 'Permission denied', str(path))
        return listed(path)

    monkeypatch.setattr(Path, 'iterdir', iterdir)
    ran = offradar('check', data_set, '--processes', 1)
    assert ran.status == 0
    assert 'no radar scans recognised in calibration, lost+found' in ran.out
    barred.add(data_set)
    assert refused('check', data_set).endswith(f'{data_set}: cannot be read (Permission denied)')
