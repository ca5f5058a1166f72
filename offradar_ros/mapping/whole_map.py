"""A map file that appears whole or not at all, and never beside a log of another file."""

from __future__ import annotations

import contextlib
import datetime
import os
import secrets
import shutil
import sqlite3
import stat
from collections.abc import Iterator
from pathlib import Path

from offradar_ros.errors import MapError
from offradar_ros.mapping import schema
from offradar_ros.mapping.map_reader import check_map, consistently, log_of, rollback_log_of, status_of
from offradar_ros.mapping.map_rows import MapRows
from offradar_ros.mapping.seal import Seal
from offradar_ros.mapping.sealed_rows import SealedRows
from offradar_ros.mapping.stored_map import StoredMap
from offradar_ros.mapping.writer_lock import has_writer
from offradar_ros.records import unstructure
from offradar_ros.whole_file import sync_folder


def write_map(path: Path, content: StoredMap, *, overwrite: bool = False) -> Seal:
    """Write a map as a new file, and read it to see that it is all there; returns its seal.

    MapError if that fails, and if there is a file already and `overwrite` is false; what was there is then unchanged.
    """
    with _placed(path, overwrite) as draft:
        seal = _write(draft, content)
        _require_same(path, draft, seal)
    return seal


def back_up(path: Path, copy: Path, *, overwrite: bool = False) -> None:
    """Copy the map at `path`, all of one transaction, while another process may write it.

    MapError if that fails, and if there is a file at `copy` already and `overwrite` is false.
    """
    status, present = status_of(path), status_of(copy)
    if status and present and os.path.samestat(status, present):
        raise MapError(f'{copy}: is the map itself: give the copy another name')
    if os.path.lexists(copy) and not overwrite:
        raise MapError(f'{copy}: is there already and is not overwritten: --overwrite replaces it')
    if has_writer(copy):
        raise MapError(f'{copy}: is in use by another process that writes it: give the copy another name')
    with _placed(copy, overwrite) as draft:

        def fill(rows: MapRows) -> Seal | None:
            try:
                with contextlib.closing(sqlite3.connect(draft)) as target:
                    rows.connection.backup(target)
            except sqlite3.Error as error:
                raise MapError(f'{copy}: a map cannot be written there ({error})') from error
            return rows.seal

        seal, _ = consistently(path, fill)
        try:
            _require_same(copy, draft, seal)
        except MapError:
            # Else it is the copy that is damaged.
            check_map(path)
            raise


def copy_open(connection: sqlite3.Connection, copy: Path, seal: Seal) -> None:
    """Copy an open map, whose seal is `seal`, to a new file; MapError if that fails."""
    with _placed(copy, overwrite=False) as draft:
        with contextlib.closing(sqlite3.connect(draft)) as target:
            connection.backup(target)
        _require_same(copy, draft, seal)


def set_aside(path: Path, *logs: Path) -> str:
    """Rename logs beside the map at `path` that belong to another file, so that they are never applied to it.

    Returns what was done, in one line, '' for nothing; MapError if it cannot be done.
    """
    done = []
    for log in logs:
        try:
            if not log.stat().st_size:
                log.unlink()
                continue
            aside = log.with_name(f'{log.name}.stale-{utc_stamp()}')
            log.rename(aside)
            done.append(f'{log.name} does not belong to the map and was not applied: it is kept as {aside.name}')
        except FileNotFoundError:
            continue
        except OSError as error:
            raise MapError(
                f'{log}: does not belong to the map beside it, and cannot be renamed ({error.strerror}): move it away'
            ) from error
    if log_of(path) in logs:
        # Only an index of that log.
        with contextlib.suppress(OSError):
            path.with_name(path.name + '-shm').unlink()
    return f'{path}: {"; ".join(done)}' if done else ''


def utc_stamp() -> str:
    """The time now, for names of files that are kept."""
    return datetime.datetime.now(datetime.timezone.utc).strftime('%Y%m%dT%H%M%S.%fZ')


@contextlib.contextmanager
def _placed(path: Path, overwrite: bool) -> Iterator[Path]:
    """Yields the path of a draft in a folder of its own; it gets the name `path` at the end of the block."""
    try:
        if os.path.lexists(path) and not overwrite:
            raise MapError(f'{path}: is there already and is not overwritten')
        # Nobody else can put a link in the place of the draft or of SQLite's own files beside it.
        folder = path.parent / f'.offradar-{secrets.token_hex(8)}'
        folder.mkdir(0o700)
        try:
            draft = folder / 'draft'
            yield draft
            _sync(draft)
            _place(draft, path, overwrite)
            sync_folder(path.parent)
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    except sqlite3.Error as error:
        raise MapError(f'{path}: a map cannot be written there ({error})') from error
    except OSError as error:
        raise MapError(f'{path}: a map cannot be written there ({error.strerror})') from error


def _place(draft: Path, path: Path, overwrite: bool) -> None:
    set_aside(path, log_of(path), rollback_log_of(path))
    if overwrite:
        with contextlib.suppress(FileNotFoundError):
            status = path.lstat()
            if stat.S_ISREG(status.st_mode):
                draft.chmod(stat.S_IMODE(status.st_mode))
        draft.replace(path)
        return
    try:
        # Unlike a renaming, this never replaces a file that has appeared meanwhile.
        os.link(draft, path)
    except FileExistsError:
        raise MapError(f'{path}: is there already and is not overwritten') from None
    except OSError:
        # A file system without hard links.
        if os.path.lexists(path):
            raise MapError(f'{path}: is there already and is not overwritten') from None
        draft.rename(path)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _require_same(path: Path, draft: Path, seal: Seal | None) -> None:
    try:
        written, _ = check_map(draft)
    except MapError as error:
        raise MapError(f'{path}: what was written there cannot be read ({error})'.replace(f'{draft}: ', '')) from error
    if (written.mark if written else None) != (seal.mark if seal else None):
        raise MapError(f'{path}: what was written there is not what was read: is the disk damaged?')


def _write(draft: Path, content: StoredMap) -> Seal:
    empty = Seal.new()
    with contextlib.closing(sqlite3.connect(draft, isolation_level=None)) as connection:
        connection.executescript(schema.CREATE)
        # The draft is synced as a whole before it gets its name.
        connection.execute('PRAGMA synchronous = OFF')
        connection.execute('BEGIN')
        rows = SealedRows(connection, empty.sums)
        rows.put_meta('model', unstructure(content.model))
        rows.put_meta('origin', unstructure(content.origin))
        rows.put_meta('next_place_id', content.next_place_id)
        rows.put_meta('created', datetime.datetime.now(datetime.timezone.utc).isoformat(timespec='seconds'))
        for session in content.sessions:
            rows.put_session(session)
        rows.put_places(content.places, content.anchors_m)
        for session_id, before in content.before.items():
            rows.put_undo(session_id, before, content.columns.dimension)
        rows.put_signatures(content.signatures)
        seal = empty.next(rows.sums, is_folded=True)
        seal.write(connection)
        connection.execute('COMMIT')
        connection.execute('PRAGMA journal_mode = WAL')
    return seal
