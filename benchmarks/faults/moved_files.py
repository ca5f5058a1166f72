"""Map files that are removed, replaced, copied, cut or locked while a map server works on them.

In each row a map server has two ended sessions and a running one when something happens to its files; then the running
one is ended. An end that is answered with success must be in a file, whole; what others put in the place must not be
overwritten; and the sessions that were ended before must be in some file of the folder when the server has stopped.
"""

from __future__ import annotations

import dataclasses
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from faults.acknowledged_sessions import ENDED, INFO, judge, known_embedding
from faults.child_batches import run_in_children
from faults.content_digest import content_digest
from faults.free_domains import free_domains
from faults.map_caller import PARAMETERS, MapCaller, session_of
from faults.result import CRASHED, DIFFERENT, LOST, REFUSED, SAME, Result, Settings, Verdict, summed
from offradar_ros.config import MapConfig
from offradar_ros.errors import OffradarError
from offradar_ros.lab.live.node_processes import READY, NodeProcess, isolated_environment, parameter_arguments
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.store import MapStore
from offradar_ros.types import Pose

NAME = 'files'
LANES = 2
READY_S = 60.0
FULL_DISK_BYTES = 4096
"""On the disk that is full nothing can be written beyond this."""


class WrongOutcomeError(Exception):
    """What happened is not what must happen; carries the verdict."""

    def __init__(self, word: str, detail: str) -> None:
        super().__init__(detail)
        self.verdict = Verdict(word, detail)


class Scene:
    """A map server with two ended sessions and a running one, in a folder of its own."""

    def __init__(self, folder: Path, domain_id: int) -> None:
        self.folder, self.path = folder / 'maps', folder / 'maps' / 'town.db'
        self.folder.mkdir(parents=True)
        self._environment = isolated_environment(domain_id)
        self._logs = folder
        self.server = self.start('server')
        self.caller = MapCaller(domain_id)
        self.caller.wait_until_heard()
        self.ended: dict[int, str] = {}
        self.older = folder / 'older.db'
        self._end(self._begin())
        shutil.copy(self.path, self.older)
        self._end(self._begin())
        self._begin()
        self.answer = ''

    def start(self, log: str) -> NodeProcess:
        """A map server on the file, once it is active or has ended."""
        arguments = parameter_arguments({**PARAMETERS, 'map.path': self.path, 'map.autosave_s': 0.05})
        node = NodeProcess('map_server_node', arguments, self._environment, self._logs / f'{log}.log')
        deadline_s = time.monotonic() + READY_S
        while READY not in node.log.read_text() and node.process.poll() is None and time.monotonic() < deadline_s:
            time.sleep(0.02)
        return node

    def _begin(self) -> int:
        # The first one runs already.
        number = session_of(self.caller.call('start_session')[1])
        self.caller.send_scans()
        return number

    def _end(self, number: int) -> bool:
        success, self.answer = self.caller.call('end_session')
        if success:
            self.ended[number] = ENDED
        elif '\n' in self.answer:
            raise WrongOutcomeError(CRASHED, f'an answer of several lines: {self.answer[:200]}')
        return success

    def end(self) -> bool:
        """End the running session; whether that was answered with success."""
        return self._end(max(self.ended) + 1)

    def close(self) -> None:
        """Stop the server as Ctrl-C does."""
        status = self.server.stop()
        text = self.server.log.read_text()
        if status not in (0, 1, -signal.SIGKILL) or 'Traceback' in text:
            raise WrongOutcomeError(CRASHED, f'the map server ended with status {status}: {text[-200:]}')

    def require_all_in_some_file(self) -> None:
        """Every acknowledged session must be in one file."""
        found = [
            judge(path, self.ended) for path in sorted(self.folder.parent.rglob('*')) if path.is_file() and is_map(path)
        ]
        if not any(verdict.word == SAME for verdict in found):
            raise WrongOutcomeError(LOST, f'sessions {sorted(self.ended)} are in no file: {[v.detail for v in found]}')

    def require_all_at(self, path: Path) -> None:
        """Every acknowledged session must be in this file."""
        verdict = judge(path, self.ended)
        if verdict.word != SAME:
            raise WrongOutcomeError(verdict.word, f'{path.name}: {verdict.detail}')


def is_map(path: Path) -> bool:
    """Whether it opens as a map."""
    try:
        MapStore.open_read_only(path)
    except OffradarError:
        return False
    return True


def content_of(path: Path) -> str:
    """A digest of the places, sessions and signatures of a map."""
    stored = MapStore.open_read_only(path)
    return content_digest(stored.places, stored.sessions, stored.signatures)


def write_other_map(path: Path) -> None:
    """Write another town's map."""
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(INFO)
        session_map.start_session('another town', 0)
        session_map.merge(known_embedding(1), Pose(0.0, 0.0, 0.0))
        session_map.end_session()


# The rows. Each returns whether the running session was ended with success.


def nothing(scene: Scene) -> bool:
    """Nothing happens."""
    if not scene.end():
        raise WrongOutcomeError(DIFFERENT, f'refused without a cause: {scene.answer}')
    scene.require_all_at(scene.path)
    return True


def removed(scene: Scene) -> bool:
    """The file is removed, with its log."""
    for path in scene.folder.glob('town.db*'):
        if path.suffix != '.lock':
            path.unlink()
    return scene.end()


def file_alone_removed(scene: Scene) -> bool:
    """The file is removed, its log is not."""
    scene.path.unlink()
    return scene.end()


def folder_removed(scene: Scene) -> bool:
    """The whole folder is removed; an older copy is elsewhere."""
    shutil.rmtree(scene.folder)
    done = scene.end()
    scene.close()
    # There is no folder to rescue to: only an answer of success would be wrong.
    if done:
        raise WrongOutcomeError(LOST, 'the end was answered with success, and there is no folder')
    scene.ended = {min(scene.ended): ENDED}
    return done


def moved_away(scene: Scene) -> bool:
    """The file is renamed."""
    scene.path.rename(scene.folder / 'moved.db')
    return scene.end()


def replaced_by_another(scene: Scene) -> bool:
    """Another map is moved to its place."""
    other = scene.folder.parent / 'other.db'
    write_other_map(other)
    expected = content_of(other)
    other.replace(scene.path)
    done = scene.end()
    scene.close()
    if not is_map(scene.path) or content_of(scene.path) != expected:
        raise WrongOutcomeError(DIFFERENT, 'the map that was put there holds something else')
    return done


def overwritten_by_an_older_copy(scene: Scene) -> bool:
    """An older copy is copied over it, as cp does, into the same file."""
    shutil.copyfile(scene.older, scene.path)
    return scene.end()


def replaced_by_an_older_copy(scene: Scene) -> bool:
    """An older copy is moved to its place."""
    shutil.copyfile(scene.older, scene.folder / 'town.new')
    (scene.folder / 'town.new').replace(scene.path)
    return scene.end()


def emptied(scene: Scene) -> bool:
    """The file is cut to nothing."""
    os.truncate(scene.path, 0)
    return scene.end()


def lock_removed(scene: Scene) -> bool:
    """The lock file is removed and a second server is started on the file: not both may write."""
    for path in scene.folder.glob('*lock*'):
        path.unlink()
    second = scene.start('second')
    runs = second.process.poll() is None
    done = scene.end()
    second.stop()
    if runs and done:
        # Both opened it: then the first one's session must have reached the file all the same.
        scene.close()
        scene.require_all_at(scene.path)
    return done


def second_server(scene: Scene) -> bool:
    """A second server is started on the file: it must refuse, in one line."""
    second = scene.start('second')
    runs = second.process.poll() is None
    second.stop()
    lines = [line for line in second.log.read_text().splitlines() if line.startswith('error: ')]
    if runs or len(lines) != 1:
        raise WrongOutcomeError(DIFFERENT, 'a second map server opened the file')
    return scene.end()


def copied_while_running(scene: Scene) -> bool:
    """The file alone is copied while a session runs: the copy holds what was ended."""
    copy = scene.folder.parent / 'copy.db'
    shutil.copy(scene.path, copy)
    scene.require_all_at(copy)
    return scene.end()


def copied_after_the_end(scene: Scene) -> bool:
    """The file alone is copied after an end, while the server runs on: the copy holds that session."""
    done = scene.end()
    copy = scene.folder.parent / 'copy.db'
    shutil.copy(scene.path, copy)
    scene.require_all_at(copy)
    return done


def log_removed_after_a_kill(scene: Scene) -> bool:
    """The server is killed after an end, and the file alone is kept."""
    done = scene.end()
    scene.server.process.kill()
    scene.server.process.wait()
    for suffix in ('-wal', '-shm', '-journal'):
        scene.path.with_name(scene.path.name + suffix).unlink(missing_ok=True)
    scene.require_all_at(scene.path)
    return done


def older_copy_beside_a_log(scene: Scene) -> bool:
    """The server is killed while a session runs, and an older copy is copied over the file that it leaves."""
    scene.server.process.kill()
    scene.server.process.wait()
    content = scene.older.read_bytes()
    scene.path.write_bytes(content)
    # Only the first session is in that copy. A log that is not its own must not change it.
    first = {min(scene.ended): ENDED}
    verdict = judge(scene.path, first)
    again = scene.start('again')
    refused = again.process.poll() is not None
    again.stop()
    if not refused and verdict.word != SAME:
        raise WrongOutcomeError(verdict.word, f'opened by a server, but: {verdict.detail}')
    if not refused:
        after = judge(scene.path, first)
        if after.word != SAME:
            raise WrongOutcomeError(after.word, after.detail)
    scene.ended = first
    return False


def backup_while_running(scene: Scene) -> bool:
    """`offradar map --backup` while a session runs: the copy holds what was ended."""
    copy = scene.folder.parent / 'backup.db'
    command = [sys.executable, '-m', 'offradar_ros.cli.main', 'map', str(scene.path), '--backup', str(copy)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise WrongOutcomeError(DIFFERENT, f'no backup: {done.stderr[-200:]}')
    scene.require_all_at(copy)
    return scene.end()


def disk_full(scene: Scene) -> bool:
    """No more can be written: an end is refused, and what was ended before stays."""
    resource.prlimit(scene.server.process.pid, resource.RLIMIT_FSIZE, (FULL_DISK_BYTES, resource.RLIM_INFINITY))
    done = scene.end()
    resource.prlimit(scene.server.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    scene.require_all_at(scene.path)
    return done


ROWS: tuple[Callable[[Scene], bool], ...] = (
    nothing,
    removed,
    file_alone_removed,
    folder_removed,
    moved_away,
    replaced_by_another,
    overwritten_by_an_older_copy,
    replaced_by_an_older_copy,
    emptied,
    lock_removed,
    second_server,
    copied_while_running,
    copied_after_the_end,
    log_removed_after_a_kill,
    older_copy_beside_a_log,
    backup_while_running,
    disk_full,
)


def run(settings: Settings) -> list[Result]:
    """Every row, whatever the scale: there are few."""
    started_s = time.monotonic()
    with free_domains(LANES) as domain_ids:

        def attempt(index: int) -> Verdict:
            os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
            return play(ROWS[index], settings.folder / f'row_{index}', domain_ids[index % LANES])

        verdicts = run_in_children(len(ROWS), attempt, lanes=LANES)
    seconds = time.monotonic() - started_s
    return [
        summed(NAME, f'map files: {row.__name__.replace("_", " ")}', [verdict], seconds / len(ROWS))
        for row, verdict in zip(ROWS, verdicts, strict=True)
    ]


def play(row: Callable[[Scene], bool], folder: Path, domain_id: int) -> Verdict:
    """One row, and what must hold after each."""
    scene = Scene(folder, domain_id)
    try:
        done = row(scene)
        scene.close()
        scene.require_all_in_some_file()
    except WrongOutcomeError as wrong:
        return dataclasses.replace(wrong.verdict)
    finally:
        scene.server.stop()
        scene.caller.close()
    return Verdict(SAME if done else REFUSED, scene.answer)
