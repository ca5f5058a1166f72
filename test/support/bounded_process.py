"""Code that runs in a process of its own with little memory or disk, so that what exhausts either is noticed there."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
MEMORY = 640 * 2**20
"""Bytes beyond what the imports take."""

_PROGRAM = """
import resource, sys
from pathlib import Path
{imports}
from offradar_ros.errors import OffradarError
used = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + {memory}, resource.RLIM_INFINITY))
if {file_bytes}:
    resource.setrlimit(resource.RLIMIT_FSIZE, ({file_bytes}, resource.RLIM_INFINITY))
try:
{code}
except OffradarError as error:
    print(error)
    sys.exit(3)
"""
REFUSED = 3
"""Exit status where the code raised an error of ours."""


def run_bounded(
    imports: str, code: str, *arguments: Path | str, memory: int = MEMORY, file_bytes: int = 0, timeout_s: float = 120.0
) -> tuple[int, str]:
    """Exit status and output of `code`, which finds `arguments` in ``sys.argv``.

    No file may grow beyond `file_bytes`, as on a full disk; 0 sets no limit.
    """
    program = _PROGRAM.format(
        imports=textwrap.dedent(imports),
        code=textwrap.indent(textwrap.dedent(code), '    '),
        memory=memory,
        file_bytes=file_bytes,
    )
    done = subprocess.run(
        [sys.executable, '-c', program, *map(str, arguments)],
        cwd=PROJECT,
        # Threads of these libraries reserve address space.
        env={**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=timeout_s,
    )
    return done.returncode, done.stdout


def refusal(imports: str, code: str, *arguments: Path | str, memory: int = MEMORY, file_bytes: int = 0) -> str:
    """The one line with which `code` refuses what it is given, as `run_bounded`."""
    status, output = run_bounded(imports, code, *arguments, memory=memory, file_bytes=file_bytes)
    assert status == REFUSED, f'status {status}: {output[-2000:]}'
    lines = output.splitlines()
    assert len(lines) == 1, output[-2000:]
    return lines[0]
