"""Synthetic maps of any size: places on a square grid, with random L2-normalised means."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.mapping.store import MapStore
from offradar_ros.mapping.stored_map import StoredSession
from offradar_ros.types import PlaceTable

DIMENSION = 128
SPACING_M = 10.0
MODEL = ModelInfo('synthetic', 'a' * 64, DIMENSION, {})
_CHUNK = 65536


def unit_means(places: int, seed: int) -> NDArray[np.float32]:
    """(N, 128) random L2-normalised means."""
    rng = np.random.default_rng(seed)
    means = np.empty((places, DIMENSION), np.float32)
    for start in range(0, places, _CHUNK):
        part = rng.standard_normal((min(_CHUNK, places - start), DIMENSION), dtype=np.float32)
        means[start : start + len(part)] = part / np.linalg.norm(part, axis=1, keepdims=True)
    return means


def synthetic_table(places: int, seed: int) -> PlaceTable:
    """A table of places 10 m apart, each with U = 1."""
    side = max(1, int(np.ceil(np.sqrt(places))))
    ids = np.arange(places)
    positions_m = np.stack([ids // side * SPACING_M, ids % side * SPACING_M, np.zeros(places)], axis=1)
    return PlaceTable(
        place_ids=ids,
        session_ids=np.ones(places, np.int32),
        stamps_ns=ids + 1,
        positions_m=positions_m,
        yaws_rad=np.full(places, np.nan),
        yaw_sds_rad=np.full(places, np.nan, np.float32),
        uncertainties=np.ones(places, np.float32),
        means=unit_means(places, seed),
    )


def near_some(means: NDArray[np.float32], count: int, seed: int) -> NDArray[np.float32]:
    """(count, 128) queries: means of random places plus noise of half their length."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((count, DIMENSION), dtype=np.float32) * np.float32(0.5 / np.sqrt(DIMENSION))
    near: NDArray[np.float32] = means[rng.integers(0, len(means), count)] + noise
    return near


def map_file(folder: Path, places: int, seed: int) -> Path:
    """The file of a map of `places` places, written once."""
    path = folder / f'synthetic_{places}_{seed}.map'
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        draft = path.with_suffix('.draft')
        draft.unlink(missing_ok=True)
        table = synthetic_table(places, seed)
        store, _ = MapStore.open(draft)
        store.write_model(MODEL)
        store.write_session(
            StoredSession(1, 'synthetic', 1, 'ended', {'inserted': places, 'replaced': 0}),
            changed=table,
            anchors_m=table.positions_m[:, :2],
            before={},
            next_place_id=places,
            origin=None,
            undoable=[],
        )
        store.close()
        draft.rename(path)
    return path
