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
NAMING = 'CRLU'
"""Operations on names."""
_HEAD = struct.Struct('<cQQQI')


@dataclasses.dataclass(frozen=True)
class Change:
    """One record, its fields as far as the operation has them; `file` is the same for all names of a file."""

    operation: str
    file: int
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
    changes = parsed(log.read_bytes())
    found = {str(path): path.read_bytes() for path in under.rglob('*') if path.is_file()}
    if at_the_end(changes) != found:
        raise SystemExit('error: the program changed files by calls that are not recorded')
    return changes


def parsed(log: bytes) -> list[Change]:
    """The records of a log."""
    changes: list[Change] = []
    names: dict[str, int] = {}
    files: dict[int, int] = {}
    at = 0
    while at < len(log):
        head, inode, offset, length, text_length = _HEAD.unpack_from(log, at)
        at += _HEAD.size
        operation, text = head.decode(), log[at : at + text_length].decode()
        at += text_length
        old, _, new = text.partition('\0')
        if operation in 'RL':
            file = names[old]
            names[new] = file
        elif operation == 'C' and old not in names:
            # An inode that has lost its last name is used again.
            file = files[inode] = names[old] = len(changes)
        else:
            file = names.get(old, -1) if operation == 'U' else files.get(inode, -1)
        if operation in 'RU':
            names.pop(old, None)
        size = length if operation == 'W' else 0
        changes.append(Change(operation, file, offset, length, (old, new) if new else (old,), log[at : at + size]))
        at += size
    return changes


def after_a_cut(changes: Sequence[Change], rng: np.random.Generator) -> dict[str, bytes]:
    """Names and contents of the files that a cut after these changes may leave."""
    synced = {change.file: number for number, change in enumerate(changes) if change.operation == 'S'}
    # Of a quarter of the cuts all writes are kept, as when only the process ends, and of a quarter none.
    share = float(rng.choice([0.0, 1.0, rng.uniform(), rng.uniform()]))
    names = _names(changes, rng)
    contents = {file: bytearray() for file in names.values()}
    for number, change in enumerate(changes):
        content = contents.get(change.file)
        if content is None or change.operation not in 'WT':
            continue
        is_safe = number < synced.get(change.file, -1)
        if not is_safe and rng.random() >= share:
            continue
        if change.operation == 'T':
            _resize(content, change.length)
        else:
            _write(content, change, None if is_safe or share == 1.0 else rng)
    return {name: bytes(contents[file]) for name, file in names.items()}


def at_the_end(changes: Sequence[Change]) -> dict[str, bytes]:
    """Names and contents of the files after all changes, without a cut."""
    names = _names_of([change for change in changes if change.operation in NAMING])
    contents = {file: bytearray() for file in names.values()}
    for change in changes:
        content = contents.get(change.file)
        if content is not None and change.operation == 'T':
            _resize(content, change.length)
        elif content is not None and change.operation == 'W':
            _write(content, change, None)
    return {name: bytes(contents[file]) for name, file in names.items()}


def _names(changes: Sequence[Change], rng: np.random.Generator) -> dict[str, int]:
    """Names that are there: all changes of a folder until it was synchronised, and all changes until some instant."""
    safe = {change.names[0]: number for number, change in enumerate(changes) if change.operation == 'S'}
    instant = int(rng.integers(len(changes) + 1))
    kept = [
        change
        for number, change in enumerate(changes)
        if change.operation in NAMING
        and (number < instant or number < safe.get(str(Path(change.names[-1]).parent), -1))
    ]
    return _names_of(kept)


def _names_of(changes: Sequence[Change]) -> dict[str, int]:
    names: dict[str, int] = {}
    for change in changes:
        if change.operation in 'RU':
            names.pop(change.names[0], None)
        if change.operation in 'CRL':
            names[change.names[-1]] = change.file
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
