"""Maps sessions into FOLDER/map.db, for power_cuts.py to record: python -m faults.recorded_mapping FOLDER SEED."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from faults.acknowledged_sessions import EITHER, ENDED, INFO, UNDONE, known_embedding
from offradar_ros.config import MapConfig
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.types import Pose

ACKNOWLEDGED = 'acknowledged'
"""A file that is written to when a session was ended or undone: in the record, it tells when that was."""
SESSIONS = 24
APART_M = 50.0


def main(folder: Path, seed: int) -> None:
    """Sessions with saves between, every fourth in a process that has just opened the file, every sixth undone."""
    rng = np.random.default_rng(seed)
    marks = os.open(folder / ACKNOWLEDGED, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    session_map = open_map(folder / 'map.db')
    stamp = 0
    for number in range(1, SESSIONS + 1):
        if number % 4 == 0:
            session_map.close()
            session_map = open_map(folder / 'map.db')
        session = session_map.start_session('', stamp)
        for k in range(int(rng.integers(2, 12))):
            stamp += 1
            session_map.merge(known_embedding(stamp), Pose(APART_M * stamp, 0.0, 0.0))
            if k % 4 == 3:
                session_map.save()
        session_map.end_session()
        tell(marks, session, ENDED)
        if number % 6 == 0:
            tell(marks, session, EITHER)
            session_map.undo_session()
            tell(marks, session, UNDONE)
    session_map.close()


def tell(marks: int, session: int, state: str) -> None:
    """Write down the state of a session."""
    os.write(marks, f'{session} {state}\n'.encode())


def open_map(path: Path) -> SessionMap:
    """The map, with its model and origin."""
    session_map = SessionMap(MapConfig(path=str(path), match_distance_m=1.0))
    session_map.adopt_model(INFO)
    if session_map.origin is None:
        session_map.set_origin(GeoPoint(51.75, -1.25, 70.0))
    return session_map


if __name__ == '__main__':
    main(Path(sys.argv[1]), int(sys.argv[2]))
