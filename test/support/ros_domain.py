"""A ROS domain for each test."""

from __future__ import annotations

import fcntl
import gc
import itertools
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

# Domains above 101 use ports that Linux gives to other programs; the campaigns of benchmarks/faults have the last ten.
DOMAINS = range(10, 90)
MOST_PARTICIPANTS = 8
"""That may live when a test starts; only the first 32 of a process are found on one machine."""


def domains_of(worker: int) -> range:
    """Where a worker of pytest-xdist looks for a free one: of more than four, some look in the same range."""
    return DOMAINS[20 * worker % len(DOMAINS) :][:20]


def participants() -> int:
    """Number of this process's participants: each has one thread for its events."""
    names = [path.read_text() for path in Path('/proc/self/task').glob('*/comm')]
    return sum(name.startswith('dds.ev.') for name in names)


_domains = itertools.cycle(domains_of(int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))))


@pytest.fixture
def domain_id() -> Iterator[int]:
    """A domain that no other run of the tests on this machine uses meanwhile; else their nodes would communicate.

    The participants of earlier tests end with the objects that the collector has not found yet. All of a process are
    numbered through, and where discovery is limited to one machine, those from the 32nd on are never found.
    """
    gc.collect()
    if (living := participants()) > MOST_PARTICIPANTS:
        pytest.fail(f'{living} participants of earlier tests live: something keeps their nodes, as a raised exception')
    for domain in itertools.islice(_domains, 20):
        with Path(tempfile.gettempdir(), f'offradar_ros_test_domain_{domain}').open('w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    pytest.fail('every ROS domain of this worker is in use by another run of the tests')
