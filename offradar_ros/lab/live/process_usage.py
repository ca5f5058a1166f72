"""Memory and CPU time of a process, as Linux counts them."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

from offradar_ros.errors import OffradarError


@dataclasses.dataclass(frozen=True)
class ProcessUsage:
    """Resident memory in bytes, with shared memory, now and at its peak; CPU time of all threads in seconds."""

    resident_bytes: int
    peak_bytes: int
    cpu_s: float


def process_usage(pid: int) -> ProcessUsage:
    """The usage so far of a running process; OffradarError if it has ended."""
    folder = Path('/proc', str(pid))
    try:
        lines = (folder / 'status').read_text(encoding='utf-8').splitlines()
        # The name, in parentheses, may contain any characters.
        times = (folder / 'stat').read_text(encoding='utf-8').rpartition(')')[2].split()
        status = dict(line.split(':', 1) for line in lines)
        resident, peak = (int(status[name].split()[0]) * 1024 for name in ('VmRSS', 'VmHWM'))
    except (OSError, KeyError) as error:
        raise OffradarError(f'process {pid}: expected a running process, but it has ended') from error
    user, system = int(times[11]), int(times[12])
    return ProcessUsage(resident, peak, (user + system) / os.sysconf('SC_CLK_TCK'))
