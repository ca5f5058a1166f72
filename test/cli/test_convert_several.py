"""`offradar convert` of a whole data set."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.datasets.oxford_writer import write_oxford
from offradar_ros.recordings.datasets.registry import open_sequence

NAMES = ('friday', 'monday', 'tuesday')
WAIT_S = 60.0


@pytest.fixture
def data_set(tmp_path: Path, street: Callable[..., Any]) -> Path:
    for number, name in enumerate(NAMES):
        write_oxford(street(count=4, noise_seed=number), tmp_path / 'data' / name)
    return tmp_path / 'data'


def test_every_sequence_becomes_a_bag(done: Callable[..., str], data_set: Path, tmp_path: Path) -> None:
    out = tmp_path / 'deep' / 'bags'
    printed = done('convert', data_set, out, '--processes', 2)
    assert printed.splitlines() == [f'{out / name}: written, 4 scans' for name in NAMES]
    assert sorted(path.name for path in out.iterdir()) == sorted(NAMES)
    for name in NAMES:
        source, bag = open_sequence(data_set / name), BagSequence(out / name)
        np.testing.assert_array_equal(bag.stamps_ns, source.stamps_ns)
        np.testing.assert_array_equal(bag.scan(3).power, source.scan(3).power)


def test_the_number_of_processes_changes_nothing(done: Callable[..., str], data_set: Path, tmp_path: Path) -> None:
    for processes in (1, 2):
        done('convert', data_set, tmp_path / str(processes), '--processes', processes, '--plain')
    for name in NAMES:
        messages = []
        for processes in (1, 2):
            with Bag(tmp_path / str(processes) / name) as bag:
                messages.append([(m.topic, m.log_ns, m.cdr) for m in bag.messages()])
        assert messages[0] == messages[1]


def test_a_finished_bag_is_kept_and_an_unfinished_one_is_made_again(
    done: Callable[..., str], data_set: Path, tmp_path: Path
) -> None:
    out = tmp_path / 'bags'
    done('convert', data_set / 'monday', out / 'monday')
    before = {path: path.stat().st_mtime_ns for path in (out / 'monday').iterdir()}
    # As a run that was killed leaves it.
    cut = out / 'tuesday.0123456789abcdef.partial' / 'tuesday'
    cut.mkdir(parents=True)
    (cut / 'tuesday.mcap').write_bytes(b'\x89MCAP0\r\n')
    printed = done('convert', data_set, out).splitlines()
    assert printed == [
        f'{out / "friday"}: written, 4 scans',
        f'{out / "monday"}: there already',
        f'{out / "tuesday"}: written, 4 scans',
    ]
    assert {path: path.stat().st_mtime_ns for path in (out / 'monday').iterdir()} == before
    assert sorted(path.name for path in out.iterdir()) == sorted(NAMES)
    again = done('convert', data_set, out).splitlines()
    assert again == [f'{out / name}: there already' for name in NAMES]
    assert 'there already' not in done('convert', data_set, out, '--overwrite')
    assert {path: path.stat().st_mtime_ns for path in (out / 'monday').iterdir()} != before


def test_one_bad_sequence_does_not_stop_the_others(
    offradar: Callable[..., Any], done: Callable[..., str], data_set: Path, tmp_path: Path
) -> None:
    scan = sorted((data_set / 'friday' / 'radar').glob('*.png'))[2]
    scan.write_bytes(scan.read_bytes()[:1000])
    out = tmp_path / 'bags'
    (out / 'tuesday').mkdir(parents=True)
    (out / 'tuesday' / 'thesis.tex').write_text('years of work')
    ran = offradar('convert', data_set, out, '--processes', 2)
    assert ran.status == 1
    assert ran.out.splitlines() == [f'{out / "monday"}: written, 4 scans']
    reported = [line for line in ran.err.splitlines() if line.startswith(('error: ', '2 of'))]
    assert reported == [
        f'error: {out / "friday"}: {scan}: truncated PNG, it ends after 1000 bytes '
        '(--skip-unreadable leaves such scans out)',
        f'error: {out / "tuesday"}: {out / "tuesday"}: exists already: choose another folder or pass --overwrite',
        '2 of 3 sequences not converted',
    ]
    (out / 'tuesday' / 'thesis.tex').unlink()
    (out / 'tuesday').rmdir()
    printed = done('convert', data_set, out, '--skip-unreadable').splitlines()
    assert printed == [
        f'{out / "friday"}: written, 3 scans',
        'skipped 1 of 4 scans that cannot be read:',
        f'  {scan}: truncated PNG, it ends after 1000 bytes',
        f'{out / "monday"}: there already',
        f'{out / "tuesday"}: written, 4 scans',
    ]


def test_options_apply_to_every_sequence(done: Callable[..., str], data_set: Path, tmp_path: Path) -> None:
    # Positions are 0.2 s apart.
    done('convert', data_set, tmp_path / 'bags', '--position-offset-s', '0.1')
    for name in NAMES:
        moved, source = BagSequence(tmp_path / 'bags' / name).trajectory, open_sequence(data_set / name).trajectory
        assert moved is not None and source is not None
        assert np.isin(moved.stamps_ns, source.stamps_ns + 100_000_000).all()


def test_bags_are_not_put_among_the_sequences(refused: Callable[..., str], data_set: Path) -> None:
    assert 'expected another folder' in refused('convert', data_set, data_set)
    assert sorted(path.name for path in data_set.iterdir()) == sorted(NAMES)


def test_ctrl_c_keeps_finished_bags_and_the_next_run_continues(
    done: Callable[..., str], data_set: Path, street: Callable[..., Any], tmp_path: Path
) -> None:
    unfinished = write_oxford(street(count=3), data_set / 'zoo')
    # So many scans that it is not at its end when it is interrupted.
    last = max((unfinished / 'radar').glob('*.png'))
    more = [last.with_name(f'{int(last.stem) + number * 250_000}.png') for number in range(1, 20_000)]
    for link in more:
        link.symlink_to(last.name)
    out = tmp_path / 'bags'
    # A shell's background jobs, such as a run of these tests may be, and all that they start ignore Ctrl-C.
    command = ['env', '--default-signal=INT', sys.executable, '-m', 'offradar_ros.cli.main']
    process = subprocess.Popen(
        [*command, 'convert', str(data_set), str(out), '--processes', '2'],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline_s = time.monotonic() + WAIT_S
    while not (all((out / name).exists() for name in NAMES) and any(out.glob('zoo.*.partial/**/*.mcap'))):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    printed = ''.join(process.communicate(timeout=WAIT_S))
    assert process.returncode != 0
    assert 'Traceback' not in printed, printed
    assert sorted(path.name for path in out.iterdir()) == sorted(NAMES)
    for link in more:
        link.unlink()
    assert done('convert', data_set, out).count('there already') == 3
    assert len(BagSequence(out / 'zoo')) == 3
