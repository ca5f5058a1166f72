"""Commands run as a user would, within the test: the whole command line, from its arguments to its exit status."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import pytest
from street_sequence import StreetSequence

from offradar_ros.cli.main import main

RING_KEY = ('--params', Path(__file__).with_name('ring_key.yaml'))
"""Options of a command whose test needs a quick encoder, whichever it is."""

BAR = re.compile('━+.* left ')


class Ran(NamedTuple):
    """What a command printed, and how it ended."""

    status: int
    out: str
    err: str


@pytest.fixture
def offradar(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    """Runs a command to its end: `offradar('check', folder)`."""

    def run(*arguments: object) -> Ran:
        monkeypatch.setattr(sys, 'argv', ['offradar', *map(str, arguments)])
        capsys.readouterr()
        try:
            status = main()
        except SystemExit as ended:
            status = int(ended.code or 0)
        return Ran(status, *capsys.readouterr())

    return run


@pytest.fixture
def done(offradar: Callable[..., Ran]) -> Callable[..., str]:
    """Runs a command that must succeed, and returns what it printed on stdout."""

    def run(*arguments: object) -> str:
        ran = offradar(*arguments)
        assert ran.status == 0, ran.err
        assert not BAR.search(ran.out)
        return ran.out

    return run


@pytest.fixture
def refused(offradar: Callable[..., Ran]) -> Callable[..., str]:
    """Runs a command that must fail with status 1 and one line on stderr (beside progress), and returns that line."""

    def run(*arguments: object) -> str:
        ran = offradar(*arguments)
        (line,) = [line for line in ran.err.splitlines() if line and not BAR.search(line)]
        assert (ran.status, ran.out) == (1, '')
        assert line.startswith('error: ')
        return line

    return run


@pytest.fixture
def radiate_folder(tmp_path: Path, street: Callable[..., StreetSequence]) -> Path:
    """Five scans in the layout of RADIATE, with positions a minute late."""
    drive = street(count=5)
    root = tmp_path / 'city_1'
    (root / 'Navtech_Polar').mkdir(parents=True)
    (root / 'GPS_IMU_Twist').mkdir()

    def line(number: int, stamp_ns: int) -> str:
        return f'Frame: {number:06d} Time: {stamp_ns // 10**9}.{stamp_ns % 10**9:09d}\n'

    for index in range(5):
        cv2.imwrite(str(root / 'Navtech_Polar' / f'{index + 1:06d}.png'), drive.scan(index).power.T)
    stamps = [line(index + 1, int(stamp)) for index, stamp in enumerate(drive.stamps_ns)]
    (root / 'Navtech_Polar.txt').write_text(''.join(stamps))
    track = drive.trajectory
    for index, position in enumerate(track.positions.tolist()):
        (root / 'GPS_IMU_Twist' / f'{index + 1:06d}.txt').write_text(', '.join(map(repr, position)) + '\n')
    late = [line(index + 1, int(stamp) + 60 * 10**9) for index, stamp in enumerate(track.stamps_ns)]
    (root / 'GPS_IMU_Twist.txt').write_text(''.join(late))
    return root
