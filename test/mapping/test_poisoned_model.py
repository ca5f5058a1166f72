"""A map file that says something impossible about its model is refused in one line: it takes no memory first."""

from __future__ import annotations

import contextlib
import json
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offradar_ros.config import MapConfig, QueryConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import MapError
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.store import MapStore
from offradar_ros.stages.query import QueryStage
from offradar_ros.types import Embedding, Pose

MODEL = ModelInfo('ring_key', 'ab' * 32, 3, {})


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / 'town.db'
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(MODEL)
        session_map.start_session('one', 0)
        session_map.merge(Embedding(1, np.ones(3, np.float32), np.ones(3, np.float32), 'ab' * 32), Pose(0.0, 0.0))
        session_map.end_session()
    return path


def poison(path: Path, changes: dict[str, Any]) -> None:
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        model = json.loads(connection.execute("SELECT value FROM meta WHERE key = 'model'").fetchone()[0])
        connection.execute("UPDATE meta SET value = ? WHERE key = 'model'", (json.dumps(model | changes),))


@pytest.mark.parametrize(
    'changes',
    [
        {'dimension': 10**12},
        {'dimension': 65_537},
        {'dimension': 4},
        {'dimension': 0},
        {'dimension': -3},
        {'fingerprint': 'zz' * 32},
        {'fingerprint': 'ab' * 31},
        {'metadata': {str(number): '' for number in range(65)}},
        {'metadata': {'a': '\ud800'}},
    ],
)
def test_such_a_file_is_refused_by_whoever_reads_it(path: Path, changes: dict[str, Any]) -> None:
    poison(path, changes)
    before = path.read_bytes()
    for read in (
        lambda: MapStore.open_read_only(path),
        lambda: SessionMap(MapConfig(path=str(path))),
        lambda: QueryStage(QueryConfig(map_path=str(path))).open_file(),
    ):
        with pytest.raises(MapError, match=r'town\.db: ') as refusal:
            read()
        assert len(str(refusal.value).splitlines()) == 1
    assert path.read_bytes() == before
