"""Draws batches: m places far apart, two views of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offradar_ros.errors import DataError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.config import BatchConfig
from offradar_ros.lab.training.receiver_changes import draw_changes


class Batch(NamedTuple):
    """One batch of 2m views; views i and i + m are of the same place.

    Attributes:
        scans: (2m,) int64, numbers of scans, counted over all drives.
        spins: (2m,) int64, number of azimuths by which each is rotated.
        changes: (2m, 3) float64, changes of each one's receiver (see `draw_changes`).
    """

    scans: NDArray[np.int64]
    spins: NDArray[np.int64]
    changes: NDArray[np.float64]


class BatchSampler:
    """Batches that depend on the seed and the step alone: a run can be resumed at any step without more state."""

    def __init__(self, drives: Sequence[Drive], config: BatchConfig, seed: int, rank: int = 0) -> None:
        """`rank` is the number of this process; each process draws different batches. DataError without drives."""
        if not drives:
            raise DataError('nothing to train on: expected data.worlds, data.sequences or data.split')
        self.config = config
        self._seed = [seed, rank]
        lengths = [len(drive) for drive in drives]
        worlds = {world: number for number, world in enumerate(dict.fromkeys(drive.world for drive in drives))}
        self.drives = tuple(drives)
        self.drive_of: NDArray[np.int64] = np.repeat(np.arange(len(drives)), lengths)
        self.row_of: NDArray[np.int64] = np.concatenate([np.arange(length) for length in lengths])
        self.world_of: NDArray[np.int64] = np.repeat([worlds[drive.world] for drive in drives], lengths)
        self.positions_m: NDArray[np.float64] = np.concatenate([drive.poses[:, :2] for drive in drives])
        self.severities: NDArray[np.float32] = np.concatenate([drive.severities for drive in drives]).astype(np.float32)
        self.kinds = tuple(str(kind) for drive in drives for kind in drive.kinds)
        self._is_degraded = np.array([kind != '' for kind in self.kinds])
        self._azimuths = np.array([len(drive.scan(0).azimuths_rad) for drive in drives])
        self._members = [np.flatnonzero(self.world_of == number) for number in range(len(worlds))]

    def batch(self, step: int) -> Batch:
        """The batch of a step: views of different places are more than `negative_m` apart, or of different worlds.

        DataError if the drives do not have enough places that far apart.
        """
        rng = np.random.default_rng([*self._seed, step])
        places, worlds = self.config.places, self.config.worlds
        pools, per_pool = [np.arange(len(self.row_of))], places
        if worlds:
            # If a world is too small for its share, the next ones provide the rest.
            pools, per_pool = [self._members[k] for k in rng.permutation(len(self._members))], -(-places // worlds)
        free = np.ones(len(self.row_of), np.bool_)
        pairs: list[tuple[int, int]] = []
        for pool in pools:
            for _ in range(min(per_pool, places - len(pairs))):
                pair = self._place(pool, free, rng)
                if pair is None:
                    break
                pairs.append(pair)
            if len(pairs) == places:
                scans = np.array(pairs, np.int64).T.ravel()
                return Batch(scans, self._spins(scans, rng), draw_changes(self.config, len(scans), rng))
        raise DataError(
            f'a batch of {places} places more than {self.config.negative_m:g} m apart is not found among '
            f'{len(self.row_of)} scans of {len(self._members)} worlds: expected fewer batch.places or more data'
        )

    def _place(
        self, pool: NDArray[np.int64], free: NDArray[np.bool_], rng: np.random.Generator
    ) -> tuple[int, int] | None:
        """An anchor from `pool` and its other view, both `free`; what is near either is then marked as not free."""
        while True:
            candidates = pool[free[pool]]
            if not len(candidates):
                return None
            anchor = self._choose(candidates, rng)
            near = self._positives(anchor)
            near = near[free[near]]
            if len(near):
                second = self._choose(near, rng)
                for view in (anchor, second):
                    free[self._within(view, self.config.negative_m)] = False
                return anchor, second
            free[anchor] = False

    def _choose(self, scans: NDArray[np.int64], rng: np.random.Generator) -> int:
        """One of `scans`; with probability `degraded_views` a degraded one, if there is one."""
        degraded = rng.random() < self.config.degraded_views
        candidates = scans[self._is_degraded[scans] == degraded]
        return int(rng.choice(candidates if len(candidates) else scans))

    def _positives(self, anchor: int) -> NDArray[np.int64]:
        """Scans that may be the other view of the anchor's place, without the anchor."""
        config = self.config
        if config.positive == 'time':
            members = self._members[self.world_of[anchor]]
            members = members[self.drive_of[members] == self.drive_of[anchor]]
            near = members[np.abs(self.row_of[members] - self.row_of[anchor]) <= config.positive_scans]
        else:
            near = self._within(anchor, config.positive_m)
        others: NDArray[np.int64] = near[near != anchor]
        return others

    def _within(self, scan: int, distance_m: float) -> NDArray[np.int64]:
        """Scans of the same world within `distance_m`."""
        members = self._members[self.world_of[scan]]
        offsets = self.positions_m[members] - self.positions_m[scan]
        return np.asarray(members[np.hypot(offsets[:, 0], offsets[:, 1]) <= distance_m], np.int64)

    def _spins(self, scans: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
        if not self.config.spin:
            return np.zeros(len(scans), np.int64)
        return rng.integers(self._azimuths[self.drive_of[scans]])
