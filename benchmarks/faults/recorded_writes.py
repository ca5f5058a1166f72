"""The changes that a process made to files, as record_writes.c records them, and what a power cut may leave of them.

What was synchronised with the disk is on it. Of what was written to a file since, any part may be: some of the writes,
and of a write any of its sectors. Names appear, change and vanish in order, and all of them up to some point in time.
"""

from __future__ import annotations

import dataclasses
import os
import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

SOURCE = Path(__file__).with_name('record_writes.c')
SECTOR = 512
_HEAD = struct.Struct('<cQQQI')


@dataclasses.dataclass(frozen=True)
class Change:
    """One record; `inode`, `offset`, `length`, `names` and `data` as far as the operation has them."""

    operation: str
    inode: int
    offset: int
    length: int
    names: tuple[str, ...]
    data: bytes


def record(command: Sequence[str], under: Path, scratch: Path, paths: Sequence[Path]) -> list[Change]:
    """Run a Python program with `paths` to import from, and return its changes of the files under a folder.

    SystemExit where there is no C compiler, or the program fails.
    """
    library, log = scratch / 'record_writes.so', scratch / 'record'
    compiler = [
        os.environ.get('CC', 'cc'),
        '-O1',
        '-shared',
        '-fPIC',
        '-o',
        str(library),
        str(SOURCE),
        '-ldl',
        '-lpthread',
    ]
    try:
        subprocess.run(compiler, check=True, capture_output=True, text=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise SystemExit(f'error: power cuts need a C compiler as cc, or in $CC: {error}') from error
    environment = {
        **os.environ,
        'LD_PRELOAD': str(library),
        'RECORD_UNDER': str(under),
        'RECORD_TO': str(log),
        'PYTHONPATH': os.pathsep.join(map(str, paths)),
    }
    done = subprocess.run([sys.executable, *command], env=environment, check=False, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f'error: the recorded program failed: {done.stderr[-500:]}')
    return parsed(log.read_bytes())


def parsed(log: bytes) -> list[Change]:
    """The records of a log."""
    changes, at = [], 0
    while at < len(log):
        operation, inode, offset, length, text_length = _HEAD.unpack_from(log, at)
        at += _HEAD.size
        names = tuple(log[at : at + text_length].decode().split('\0'))
        at += text_length
        size = length if operation == b'W' else 0
        changes.append(Change(operation.decode(), inode, offset, length, names, log[at : at + size]))
        at += size
    return changes


def after_a_cut(changes: Sequence[Change], rng: np.random.Generator) -> dict[str, bytes]:
    """Names and contents of the files that a cut after these changes may leave."""
    synced: dict[int, int] = {}
    for number, change in enumerate(changes):
        if change.operation == 'S':
            synced[change.inode] = number
    names = _names(changes, rng)
    # Of a quarter of the cuts all writes are kept, as when only the process ends, and of a quarter none.
    share = float(rng.choice([0.0, 1.0, rng.uniform(), rng.uniform()]))
    contents = {inode: bytearray() for inode in names.values()}
    for number, change in enumerate(changes):
        content = contents.get(change.inode)
        if content is None or change.operation not in 'WT':
            continue
        is_safe = number < synced.get(change.inode, -1)
        if not is_safe and rng.random() >= share:
            continue
        if change.operation == 'T':
            _resize(content, change.length)
        else:
            _write(content, change, None if is_safe or share == 1.0 else rng)
    return {name: bytes(contents[inode]) for name, inode in names.items()}


def _names(changes: Sequence[Change], rng: np.random.Generator) -> dict[str, int]:
    folders = {str(Path(name).parent) for change in changes for name in change.names if change.operation in 'CRU'}
    folder_synced = [n for n, change in enumerate(changes) if change.operation == 'S' and change.names[0] in folders]
    safe = folder_synced[-1] if folder_synced else -1
    until = int(rng.integers(safe, len(changes))) if safe < len(changes) - 1 else safe
    names: dict[str, int] = {}
    for change in changes[: until + 1]:
        if change.operation == 'C':
            names[change.names[0]] = change.inode
        elif change.operation == 'R' and change.names[0] in names:
            names[change.names[1]] = names.pop(change.names[0])
        elif change.operation == 'U':
            names.pop(change.names[0], None)
    return names


def _write(content: bytearray, change: Change, rng: np.random.Generator | None) -> None:
    """Write all of it, or with `rng` maybe only some of its sectors."""
    end = change.offset + len(change.data)
    if len(content) < end:
        content.extend(bytes(end - len(content)))
    if rng is None or rng.random() < 0.5:
        content[change.offset : end] = change.data
        return
    for at in range(change.offset - change.offset % SECTOR, end, SECTOR):
        if rng.random() < 0.5:
            first, last = max(at, change.offset), min(at + SECTOR, end)
            content[first:last] = change.data[first - change.offset : last - change.offset]


def _resize(content: bytearray, length: int) -> None:
    if length < len(content):
        del content[length:]
    else:
        content.extend(bytes(length - len(content)))
