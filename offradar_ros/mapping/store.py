"""The map on disk: committed sessions are safe against a killed process, a power cut, and a file that is taken away.

The file is in SQLite's WAL mode: a reader never makes a writer wait, so that no reader can make a session fail. After
each transaction the log is moved into the file, which alone then holds all that was committed and can be copied.
"""

from __future__ import annotations

import contextlib
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import ConfigError, MapError
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.held_file import HeldFile
from offradar_ros.mapping.held_signatures import NO_CHANGES, SignatureChanges
from offradar_ros.mapping.map_reader import check_map, log_of, open_sqlite, read_map, rollback_log_of, status_of
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.mapping.schema import VERSION
from offradar_ros.mapping.seal import Seal, read_seal
from offradar_ros.mapping.sealed_rows import SealedRows
from offradar_ros.mapping.stored_map import Before, StoredMap, StoredSession
from offradar_ros.mapping.upgrade import upgrade
from offradar_ros.mapping.whole_map import copy_open, set_aside, utc_stamp, write_map
from offradar_ros.mapping.writer_lock import WriterLock
from offradar_ros.records import unstructure
from offradar_ros.types import PlaceTable


class LostMapError(MapError):
    """The path no longer leads to the map that was opened there; nothing was written."""


class MapStore:
    """The only writer of a map file. Each method that changes the file is one transaction.

    Made by `open`. Several threads may use it, one call at a time. Each transaction first makes sure that the path
    still leads to the file that was opened, and that the file holds what this store wrote last: MapError otherwise,
    LostMapError if the file was removed or replaced.
    """

    def __init__(self, path: Path, lock: WriterLock, file: HeldFile, seal: Seal) -> None:
        self.path = path
        self.notices: tuple[str, ...] = ()
        """What was done to the file when it was opened, one line each."""
        self.is_folded = True
        """Whether the file alone holds all that was committed; false while a reader keeps the log from being moved."""
        self._lock = lock
        self._file = file
        self._seals = [seal]
        self._connection: sqlite3.Connection | None = None
        self._beside: list[tuple[int, int] | None] = []

    @classmethod
    def open(cls, path: Path) -> tuple[MapStore, StoredMap]:
        """Open the map at `path`, or create one there, and read it.

        Raises MapError for a folder that is missing or not writable, a map that another process writes, and a file
        that is not a map, damaged or of a newer version; such a file is not changed. An existing map is not written
        before the first change, unless it is of an earlier version: then a copy is kept, for version 2 as
        ``<path>.v2.bak``, and it is upgraded. A log beside it that belongs to another file is renamed.
        """
        path = _resolved(path)
        # One lock for each file, whatever its name: two writers through a link would overwrite each other.
        lock = WriterLock(path)
        file: HeldFile | None = None
        try:
            notices = []
            if status_of(path) is None:
                notices.append(set_aside(path, log_of(path), rollback_log_of(path)))
                write_map(path, _EMPTY)
            file = HeldFile(path)
            if rollback_log_of(path).exists():
                # No map has such a log, and SQLite would apply it. First see that the file is a map.
                check_map(path, with_log=False)
                notices.append(set_aside(path, rollback_log_of(path)))
            stored = read_map(path)
            if stored.is_log_foreign:
                notices.append(set_aside(path, log_of(path)))
            if stored.version < VERSION:
                file.release()
                file = None
                notices.append(upgrade(path, stored))
                file = HeldFile(path)
                stored = read_map(path)
            if stored.seal is None or stored.version < VERSION:
                raise MapError(f'{path}: the map was replaced while it was opened: open it again')
            file.note_state()
            store = cls(path, lock, file, stored.seal)
            store.notices = tuple(filter(None, notices))
            return store, stored
        except BaseException:
            if file is not None:
                file.release()
            lock.release()
            raise

    @staticmethod
    def open_read_only(path: Path) -> StoredMap:
        """Read the map at `path` and close it; another process may write it meanwhile. MapError as `read_map`."""
        return read_map(path)

    def write_model(self, model: ModelInfo, except_session: int | None = None) -> None:
        """Store the model of the embeddings, and mark running sessions as interrupted, except `except_session`."""
        with self._transaction() as rows:
            rows.mark_interrupted(except_session)
            rows.put_meta('model', unstructure(model))

    def write_session(
        self,
        session: StoredSession,
        *,
        changed: PlaceTable,
        anchors_m: NDArray[np.float64],
        before: Before,
        next_place_id: int,
        origin: GeoPoint | None,
        undoable: list[int],
        signatures: SignatureChanges = NO_CHANGES,
    ) -> None:
        """Store a session and its changes since it was last stored.

        `changed` (N places) holds their present content, `anchors_m` (N, 2) their anchors, and `before` their content
        before the session. `origin` is that of the local frame. Sessions that are not in `undoable` can no longer be
        undone. `signatures` makes the file hold those that are needed then.
        """
        with self._transaction() as rows:
            rows.mark_interrupted(session.session_id)
            rows.put_session(session)
            rows.put_meta('next_place_id', next_place_id)
            rows.put_meta('origin', unstructure(origin))
            rows.put_places(changed, anchors_m)
            rows.put_undo(session.session_id, before, changed.means.shape[1])
            rows.keep_undo(undoable)
            rows.put_signatures(signatures.added)
            rows.remove_signatures(signatures.removed)

    def undo_session(
        self, session: StoredSession, before: Before, anchors_m: NDArray[np.float64], origin: GeoPoint | None
    ) -> None:
        """Restore the content of a session's places from before it; `anchors_m` (N, 2) of the places that remain.

        Only places of the last session are restored, so no other place holds one of its scans: their signatures go.

        `origin` is that of the local frame, None where no place remains.
        """
        old = [place for place in before.values() if place]
        with self._transaction() as rows:
            rows.put_session(session)
            rows.remove_places([place_id for place_id, place in before.items() if place is None])
            if old:
                rows.put_places(PlaceTable.from_places(old, old[0].mean.size), anchors_m)
            rows.remove_undo(session.session_id)
            rows.remove_signatures_of(session.session_id)
            rows.put_meta('origin', unstructure(origin))

    def clear(self) -> Path:
        """Copy the map to ``<path>.<UTC stamp>.bak``, then delete its places and sessions; returns the copy's path.

        Nothing is deleted before the copy is on the disk and was read.
        """
        copy = self.path.with_name(f'{self.path.name}.{utc_stamp()}.bak')
        self.require_ours()
        try:
            connection = self._open_connection()
            copy_open(connection, copy, self._require_last_written(connection))
        except (sqlite3.Error, MapError) as error:
            raise MapError(f'{copy}: the map could not be copied there ({error}), so it was not cleared') from error
        with self._transaction() as rows:
            rows.clear()
            rows.put_meta('origin', None)
        return copy

    def require_ours(self) -> None:
        """LostMapError unless the path leads to the file that was opened, with the content that was written last."""
        if not self._file.is_in_place():
            raise self._lost('removed' if self._file.is_missing() else 'replaced')
        is_changed = self._file.is_changed()
        if is_changed:
            # Somebody has only touched it, or has copied another file over it.
            try:
                found, is_with_log = check_map(self.path)
            except MapError as error:
                raise self._lost('overwritten') from error
            if found is None or not any(self._is_state_of(found, seal, is_with_log) for seal in self._seals):
                raise self._lost('overwritten')
        is_beside = self._beside == self._files_beside()
        if self._connection is not None and (is_changed or not is_beside):
            # SQLite would go on with pages that it remembers, or with files that no other process can see.
            self._fold_log(self._connection)
            if self.is_folded:
                self._close_connection()
            elif not is_beside:
                raise MapError(
                    f'{self.path}: its log was removed while another process reads the map, so nothing was written: '
                    'end that process and try again'
                )
        self._file.note_state()

    def _is_state_of(self, found: Seal, seal: Seal, is_with_log: bool) -> bool:
        return found.mark == seal.mark if is_with_log or self.is_folded else seal.follows(found)

    def write_again(self, content: StoredMap) -> None:
        """Write the whole map, `content`, where its file was removed.

        LostMapError if there is another file now, MapError if it cannot be written.
        """
        if not self._file.is_missing():
            raise self._lost('replaced')
        self._lock.keep(self.path)
        seal = write_map(self.path, content)
        file = HeldFile(self.path)
        self._close_files()
        self._file = file
        self._file.note_state()
        self._seals, self.is_folded = [seal], True

    def rescue(self, content: StoredMap) -> Path:
        """Write the whole map, `content`, as a new file beside the map, or else where that is possible; its path.

        MapError if it cannot be written anywhere.
        """
        name = f'{self.path.name}.rescued-{utc_stamp()}.db'
        problem: MapError | None = None
        for folder in (self.path.parent, Path(), Path(tempfile.gettempdir())):
            try:
                write_map(folder.absolute() / name, content)
            except (MapError, OSError) as error:
                problem = MapError(str(error))
                continue
            return folder.absolute() / name
        raise MapError(f'{self.path}: the map could not be written anywhere: {problem}')

    def close(self) -> None:
        """Close the file, without a further write."""
        try:
            if self._connection is not None:
                with contextlib.suppress(MapError, sqlite3.Error):
                    self.require_ours()
                    self._fold_log(self._open_connection())
            self._close_files()
        finally:
            self._lock.release()

    def _close_files(self) -> None:
        try:
            self._close_connection()
        finally:
            self._file.release()

    def _close_connection(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _lost(self, how: str) -> LostMapError:
        if how == 'removed':
            remedy = 'put the file back, or save, which writes the whole map there again; a restart begins an empty map'
        else:
            remedy = 'move that file away and save, which writes the whole map there again; a restart takes that file'
        what = {
            'removed': 'the map file was removed',
            'replaced': 'another file is in the place of the map',
            'overwritten': 'another program has written the map file',
        }[how]
        return LostMapError(f'{self.path}: {what}, so nothing was written; the map is kept in memory: {remedy}')

    def _open_connection(self) -> sqlite3.Connection:
        if self._connection is None:
            connection = open_sqlite(self.path, 'mode=rw')
            try:
                connection.execute('PRAGMA journal_mode = WAL')
                connection.execute('PRAGMA synchronous = FULL')
                connection.execute('PRAGMA wal_autocheckpoint = 0')
                # Makes the files beside the map, and finds a log that a killed process has left.
                connection.execute('SELECT count(*) FROM sessions').fetchone()
                self._beside = self._files_beside()
                self._fold_log(connection)
            except BaseException:
                connection.close()
                raise
            self._connection = connection
        return self._connection

    def _files_beside(self) -> list[tuple[int, int] | None]:
        found = []
        for suffix in ('-wal', '-shm'):
            status = status_of(self.path.with_name(self.path.name + suffix))
            found.append((status.st_dev, status.st_ino) if status else None)
        return found

    def _fold_log(self, connection: sqlite3.Connection) -> None:
        """Move the log into the file, as far as readers allow, so that a copy of the file is a copy of the map."""
        try:
            busy, frames, folded = connection.execute('PRAGMA wal_checkpoint(TRUNCATE)').fetchone()
            self.is_folded = not busy or frames == folded >= 0
        except sqlite3.Error:
            # What was committed is in the log: a full disk, most likely.
            self.is_folded = False
        self._file.note_state()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[SealedRows]:
        self.require_ours()
        self._lock.keep(self.path)
        try:
            connection = self._open_connection()
            connection.execute('BEGIN IMMEDIATE')
            try:
                seal = self._require_last_written(connection)
                rows = SealedRows(connection, seal.sums)
                yield rows
                sealed = seal.next(rows.sums, is_folded=self.is_folded)
                sealed.write(connection)
                # Both count until the commit has returned: an error or a signal does not say whether it took place.
                self._seals = [seal, sealed]
                connection.execute('COMMIT')
                self._seals = [sealed]
            except BaseException:
                if connection.in_transaction:
                    connection.execute('ROLLBACK')
                raise
        except (sqlite3.Error, UnicodeError) as error:
            raise MapError(f'{self.path}: the map could not be written ({error}); the file is unchanged') from error
        self._fold_log(connection)
        # Removed in the meantime, a file takes with it what was just written.
        if not self._file.is_in_place():
            raise self._lost('removed' if self._file.is_missing() else 'replaced')

    def _require_last_written(self, connection: sqlite3.Connection) -> Seal:
        try:
            found = read_seal(connection)
        except (ValueError, ConfigError) as error:
            raise self._lost('overwritten') from error
        for seal in self._seals:
            if seal.mark == found.mark:
                self._seals = [seal]
                return seal
        raise self._lost('overwritten')


_EMPTY = StoredMap(None, None, 0, PlaceColumns(0), np.empty((0, 2)), (), {})


def _resolved(path: Path) -> Path:
    try:
        if path.is_dir():
            raise MapError(f'{path}: a folder: expected the path of a map file')
        return path.resolve()
    # RuntimeError: a loop of links, in Python before 3.13.
    except (OSError, ValueError, RuntimeError) as error:
        why = getattr(error, 'strerror', None) or str(error)
        raise MapError(
            f'{path}: cannot be opened ({why}): check the path, and the permissions of its folder'
        ) from error
