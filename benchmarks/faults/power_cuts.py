"""Power cuts while sessions are mapped.

Recorded writes are replayed up to an instant, and what was not yet synchronised is torn.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from faults.acknowledged_sessions import ENDED, judge, known_embedding
from faults.child_batches import run_in_children
from faults.flipped_files import PROJECT
from faults.recorded_mapping import ACKNOWLEDGED, APART_M, open_map
from faults.recorded_writes import Change, after_a_cut, record
from faults.result import SAME, Result, Settings, Verdict, summed
from offradar_ros.types import Pose

NAME = 'power'
FULL = 400
LATER_STAMP = 10**6


def run(settings: Settings) -> list[Result]:
    """Cut the power, open the map, and go on with it."""
    started_s = time.monotonic()
    folder = settings.folder / 'recorded'
    folder.mkdir()
    command = ['-m', 'faults.recorded_mapping', str(folder), str(settings.seed)]
    changes = record(command, folder, settings.folder, (PROJECT, PROJECT / 'benchmarks'))

    def attempt(index: int) -> Verdict:
        rng = np.random.default_rng([settings.seed, index])
        instant = int(rng.integers(len(changes)))
        place = settings.folder / f'cut_{index}'
        place.mkdir()
        try:
            return cut(changes[: instant + 1], folder, place, rng)
        finally:
            shutil.rmtree(place)

    verdicts = run_in_children(settings.tries(FULL), attempt)
    return [summed(NAME, 'power cuts while mapping', verdicts, time.monotonic() - started_s, changes=len(changes))]


def cut(changes: Sequence[Change], folder: Path, place: Path, rng: np.random.Generator) -> Verdict:
    """Lay the files as a cut may leave them; the map must open with all that was acknowledged, and go on."""
    acknowledged: dict[int, str] = {}
    files = []
    for change in changes:
        if Path(change.names[0]).name == ACKNOWLEDGED:
            if change.operation == 'W':
                number, _, state = change.data.decode().strip().partition(' ')
                acknowledged[int(number)] = state
        # The index of the log is in memory alone, and is made again.
        elif not change.names[0].endswith('-shm'):
            files.append(change)
    for name, content in after_a_cut(files, rng).items():
        path = place / Path(name).relative_to(folder)
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    path = place / 'map.db'
    before = judge(path, acknowledged)
    if before.word != SAME:
        return before
    session_map = open_map(path)
    session = session_map.start_session('', LATER_STAMP)
    session_map.merge(known_embedding(LATER_STAMP), Pose(0.0, APART_M, 0.0))
    session_map.end_session()
    session_map.close()
    return judge(path, acknowledged | {session: ENDED})
