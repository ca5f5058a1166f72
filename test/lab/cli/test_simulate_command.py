"""`offradar simulate`: drives as bags and folders, and their ground truth."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.datasets.registry import open_sequence

ONE_PROCESS = ('--workers', 1)


def recorded(path: Path) -> list[tuple[str, int, bytes]]:
    with Bag(path) as bag:
        return [(message.topic, message.log_ns, message.cdr) for message in bag.messages()]


def truth(path: Path) -> list[dict[str, str]]:
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def files(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob('*')) if f.is_file()}


def test_the_same_seed_gives_the_same_bytes(done: Callable[..., str], tmp_path: Path) -> None:
    for name, seed in (('one', 4), ('again', 4), ('other', 5)):
        drives = ('--sessions', 2, '--scans', 3, '--seed', seed, '--degraded', 0.5)
        done('simulate', 'city', '--out', tmp_path / name, *drives, *ONE_PROCESS)
    for session in ('session_1', 'session_2'):
        one, again, other = (recorded(tmp_path / name / session) for name in ('one', 'again', 'other'))
        assert one == again
        assert [m[:2] for m in one] == [m[:2] for m in other]
        assert one != other
        csvs = [(tmp_path / name / f'{session}.csv').read_bytes() for name in ('one', 'again', 'other')]
        assert csvs[0] == csvs[1] != csvs[2]


@pytest.mark.parametrize('format_', ['bag', 'oxford'])
def test_the_number_of_processes_changes_nothing(done: Callable[..., str], tmp_path: Path, format_: str) -> None:
    for workers in (1, 2):
        drives = ('--sessions', 1, '--scans', 12, '--degraded', 0.5, '--format', format_, '--workers', workers)
        done('simulate', 'city:2', '--out', tmp_path / f'{workers}', *drives)
    alone, together = files(tmp_path / '1'), files(tmp_path / '2')
    assert list(alone) == list(together)
    if format_ == 'bag':
        assert recorded(tmp_path / '1' / 'session_1') == recorded(tmp_path / '2' / 'session_1')
    else:
        assert alone == together and len(alone) == 12 + 4


def test_an_oxford_folder_is_read_as_such(done: Callable[..., str], tmp_path: Path) -> None:
    drives = ('--sessions', 1, '--scans', 4, '--format', 'oxford', '--sensor', 'cts350x', *ONE_PROCESS)
    done('simulate', 'city', '--out', tmp_path, *drives)
    folder = tmp_path / 'session_1'
    assert 'problem' not in done('check', folder)
    sequence = open_sequence(folder)
    assert (sequence.layout, len(sequence)) == ('oxford', 4)
    scan = sequence.scan(2)
    assert scan.power.shape == (400, 3768)
    assert scan.range_resolution_m == pytest.approx(0.0432)
    assert [int(row['stamp_ns']) for row in truth(tmp_path / 'session_1.csv')] == sequence.stamps_ns.tolist()


def test_sessions_are_drives_of_one_route_a_day_apart(done: Callable[..., str], tmp_path: Path) -> None:
    output = done('simulate', 'city', '--out', tmp_path, '--sessions', 3, '--scans', 6, *ONE_PROCESS)
    assert output == ''.join(f'{tmp_path / f"session_{n}"}: written\n' for n in (1, 2, 3))
    drives = [BagSequence(tmp_path / f'session_{n}') for n in (1, 2, 3)]
    assert [len(drive) for drive in drives] == [6, 6, 6]
    starts = [int(drive.stamps_ns[0]) for drive in drives]
    assert np.diff(starts).tolist() == [86400 * 10**9] * 2
    positions = [drive.trajectory.positions[:, :2] for drive in drives if drive.trajectory is not None]
    degrees_of_5_m = 5.0 / 60_000
    assert np.abs(positions[0] - positions[1]).max() < degrees_of_5_m
    assert np.abs(positions[0] - positions[2]).max() < degrees_of_5_m
    assert not np.array_equal(positions[0], positions[1])


def test_two_way_drives_every_second_session_backwards(done: Callable[..., str], tmp_path: Path) -> None:
    drives = ('--two-way', '--sessions', 2, '--scans', 20, *ONE_PROCESS)
    done('simulate', 'city', '--out', tmp_path, *drives)
    there, back = (
        np.array([[float(row[name]) for name in ('x_m', 'y_m', 'heading_rad')] for row in truth(tmp_path / f'{n}.csv')])
        for n in ('session_1', 'session_2')
    )
    away_m = np.linalg.norm(back[:, None, :2] - there[None, :, :2], axis=-1)
    assert np.all(away_m.min(axis=1) < 10.0)
    assert np.all(np.cos(back[:, 2] - there[away_m.argmin(axis=1), 2]) < -0.9)


def test_the_last_drive_makes_a_detour(done: Callable[..., str], tmp_path: Path) -> None:
    drives = ('--detour', 50, '--sessions', 2, '--scans', 200, *ONE_PROCESS)
    done('simulate', 'city:12', '--out', tmp_path, *drives)
    first, last = (
        np.array([[float(row[name]) for name in ('x_m', 'y_m')] for row in truth(tmp_path / f'session_{n}.csv')])
        for n in (1, 2)
    )
    away_m = np.linalg.norm(last[:, None] - first[None], axis=-1).min(axis=1)
    off = np.flatnonzero(away_m > 20.0)
    assert len(off) >= 10
    assert 15 < off[0] <= off[-1] < 185


def test_the_ground_truth_names_degraded_scans(done: Callable[..., str], tmp_path: Path) -> None:
    for share in (0.0, 0.5):
        faults = ('--degraded', share, '--kind', 'flooded', '--kind', 'blocked')
        done('simulate', 'city', '--out', tmp_path / f'{share}', '--sessions', 1, '--scans', 8, *faults, *ONE_PROCESS)
    clean, half = (BagSequence(tmp_path / f'{share}' / 'session_1') for share in (0.0, 0.5))
    differs = [not np.array_equal(clean.scan(i).power, half.scan(i).power) for i in range(8)]
    rows = truth(tmp_path / '0.5' / 'session_1.csv')
    assert [bool(row['kind']) for row in rows] == differs
    assert sum(differs) == 4
    assert {row['kind'] for row in rows} <= {'', 'flooded', 'blocked'}
    assert all((float(row['severity']) >= 0.05) == bool(row['kind']) for row in rows)


def test_weather_is_in_the_scans(done: Callable[..., str], tmp_path: Path) -> None:
    for name, weather in (('clear', 'clear'), ('wet', 'rain=80,fog=100')):
        drives = ('--sessions', 1, '--scans', 1, '--weather', weather, *ONE_PROCESS)
        done('simulate', 'city', '--out', tmp_path / name, *drives)
    clear, wet = (BagSequence(tmp_path / name / 'session_1').scan(0).power.astype(float) for name in ('clear', 'wet'))
    assert np.quantile(clear[:, 300:], 0.95) > np.quantile(wet[:, 300:], 0.95)


@pytest.fixture
def mapped(tmp_path: Path) -> Path:
    """A nav2 map with two walls, and a drive between them that takes 2 s."""
    pixels = np.full((80, 160), 254, np.uint8)
    pixels[20, 10:150] = pixels[60, 10:150] = 0
    cv2.imwrite(str(tmp_path / 'map.png'), pixels)
    lines = 'image: map.png\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n'
    (tmp_path / 'map.yaml').write_text(lines)
    (tmp_path / 'drive.tum').write_text(''.join(f'{t / 4:.3f} {10 + 2 * t} 20 0 0 0 0 1\n' for t in range(9)))
    return tmp_path / 'map.yaml'


def test_a_recorded_drive_is_followed_through_a_map(done: Callable[..., str], tmp_path: Path, mapped: Path) -> None:
    drives = ('--traversal', tmp_path / 'drive.tum', '--two-way', '--sessions', 2, *ONE_PROCESS)
    done('simulate', mapped, '--out', tmp_path / 'out', *drives)
    there, back = (truth(tmp_path / 'out' / f'session_{n}.csv') for n in (1, 2))
    assert len(there) == len(back) == 8
    assert [float(row['x_m']) for row in there] == pytest.approx([11 + 2 * k for k in range(8)], abs=0.01)
    assert [float(row['x_m']) for row in back] == pytest.approx([25 - 2 * k for k in range(8)], abs=0.01)
    scan = BagSequence(tmp_path / 'out' / 'session_1').scan(3)
    for row in (100, 300):
        assert abs(int(np.argmax(scan.power[row, 20:])) + 20 - 10.0 / 0.1736) < 8


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (('village',), 'expected city, city:SEED or the YAML file of a nav2 map'),
        (('city:x',), 'expected city, city:SEED or the YAML file of a nav2 map'),
        (('city', '--sensor', 'lidar'), 'expected one of cts350x'),
        (('city', '--weather', 'hail=3'), 'expected clear, or rain=MM_H'),
        (('city', '--weather', 'rain=900'), 'expected 0 to 150'),
        (('nowhere.yaml',), 'nowhere.yaml: cannot be read'),
        (('city', '--traversal', 'nowhere.tum'), 'nowhere.tum: cannot be read'),
        (('city', '--detour', '1000'), 'no detour of 1000 m'),
    ],
)
def test_an_invalid_argument_is_named(
    refused: Callable[..., str], tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    assert message in refused('simulate', *arguments, '--out', tmp_path / 'out')


def test_a_detour_needs_streets(refused: Callable[..., str], tmp_path: Path, mapped: Path) -> None:
    drives = ('--traversal', tmp_path / 'drive.tum', '--detour', 50, '--out', tmp_path / 'out')
    assert 'give only one' in refused('simulate', mapped, *drives)


def test_a_map_without_a_drive_is_refused(refused: Callable[..., str], tmp_path: Path, mapped: Path) -> None:
    assert 'give the drive a recorded path' in refused('simulate', mapped, '--out', tmp_path / 'out')


@pytest.mark.parametrize('format_', ['bag', 'oxford'])
def test_existing_drives_are_kept_without_overwrite(
    done: Callable[..., str], offradar: Callable[..., Any], refused: Callable[..., str], tmp_path: Path, format_: str
) -> None:
    command = ('simulate', 'city', '--out', tmp_path, '--sessions', 1, '--format', format_, *ONE_PROCESS)
    done(*command, '--scans', 2)
    before = files(tmp_path)
    assert 'exists already' in refused(*command, '--scans', 3)
    assert files(tmp_path) == before
    done(*command, '--scans', 3, '--overwrite')
    assert len(truth(tmp_path / 'session_1.csv')) == 3


def test_a_folder_of_another_format_is_not_replaced(
    done: Callable[..., str], refused: Callable[..., str], tmp_path: Path
) -> None:
    command = ('simulate', 'city', '--out', tmp_path, '--sessions', 1, '--scans', 2, *ONE_PROCESS)
    done(*command)
    assert 'not overwritten' in refused(*command, '--format', 'oxford', '--overwrite')


def test_a_folder_that_cannot_be_written_is_refused(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    assert 'cannot be written' in refused('simulate', 'city', '--out', tmp_path / 'file', '--scans', 2, *ONE_PROCESS)
