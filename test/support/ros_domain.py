"""A ROS domain for each test."""

from __future__ import annotations

import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

# Domains above 101 use ports that Linux gives to other programs; each worker of pytest-xdist has twenty.
_FIRST = 10 + 20 * int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
_domains = itertools.cycle(range(_FIRST, _FIRST + 20))


@pytest.fixture
def domain_id() -> Iterator[int]:
    """A domain that no other run of the tests on this machine uses meanwhile; else their nodes would communicate."""
    for domain in itertools.islice(_domains, 20):
        with Path(tempfile.gettempdir(), f'offradar_ros_test_domain_{domain}').open('w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    pytest.fail('every ROS domain of this worker is in use by another run of the tests')
