"""ROS domains that no other run on this machine uses meanwhile."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

# Domains above 101 use ports that Linux gives to other programs. Tests, demo and benchmarks/pipeline.py have others.
DOMAINS = range(92, 102)


@contextlib.contextmanager
def free_domains(count: int) -> Iterator[tuple[int, ...]]:
    """Yields that many domain ids, for this machine alone; SystemExit if there are not enough."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    with contextlib.ExitStack() as stack:
        found: list[int] = []
        for domain in DOMAINS:
            path = Path(tempfile.gettempdir(), f'offradar_ros_domain_{domain}')
            lock = stack.enter_context(path.open('a'))
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                found.append(domain)
            if len(found) == count:
                break
        else:
            raise SystemExit(
                f'error: {count} of the ROS domains {DOMAINS[0]} to {DOMAINS[-1]} are needed, all are in use'
            )
        yield tuple(found)
