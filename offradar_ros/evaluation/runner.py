"""An evaluation from end to end: simulate, encode, search, and keep the answers."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from offradar_ros.encoders.protocol import Encoder, ModelInfo
from offradar_ros.evaluation.answers import Answers, Pair, answers_from
from offradar_ros.evaluation.drives import VALIDATION, Drive
from offradar_ros.evaluation.embedding_cache import EmbeddedDrive, embedded
from offradar_ros.evaluation.maintenance import Ablation, ablate, rotations
from offradar_ros.evaluation.methods import Method
from offradar_ros.evaluation.protocol import Protocol
from offradar_ros.evaluation.scan_cache import CachedDrive, cached_drives

Bar = Callable[[str], AbstractContextManager[Callable[[int, int], None]]]
"""Opens a progress bar of this text, told of what is done and of how much there is."""

Worlds = dict[tuple[str, str], list[CachedDrive]]
"""Drives by group and world."""


@dataclasses.dataclass(frozen=True, eq=False)
class Measured:
    """What one method answered.

    Attributes:
        method: its name.
        weights: file of its weights, if any.
        fitted: whether each map has an encoder of its own.
        model: the encoder; of one of the maps for one that is fitted to each.
        answers: of all ordered pairs of drives of each world, for each map spacing.
        ablations: by group and map spacing; none for a method that is fitted to each map.
        validation: (V,) U of the clean validation scans, sorted; none likewise.
    """

    method: str
    weights: str
    fitted: bool
    model: ModelInfo
    answers: list[Answers]
    ablations: dict[tuple[str, float], list[Ablation]]
    validation: list[float]


def simulated_worlds(drives: Sequence[Drive], cache: Path, bar: Bar, processes: int = 0) -> Worlds:
    """Every drive with its scans, rendered now or earlier."""
    with bar('simulating drives') as progress:
        found = cached_drives(drives, cache / 'scans', progress, processes)
    worlds: Worlds = {}
    for drive in found:
        worlds.setdefault((drive.group, drive.world), []).append(drive)
    return worlds


def measure(method: Method, worlds: Worlds, protocol: Protocol, cache: Path, bar: Bar) -> Measured:
    """Encode all drives, search every drive's map for every other drive of its world, and maintain maps."""
    evaluated = {key: drives for key, drives in worlds.items() if key[0] != VALIDATION}
    clean = [drive for (group, _), drives in worlds.items() if group == VALIDATION for drive in drives]
    found: list[Answers] = []
    ablations: dict[tuple[str, float], list[Ablation]] = {}
    validation: list[float] = []
    times = max(len(drives) for drives in evaluated.values()) if method.fitted else 1
    total = times * sum(len(drive) for drives in evaluated.values() for drive in drives)
    total += 0 if method.fitted else sum(map(len, clean))
    with bar(f'{method.name}: encoding') as progress:
        embed = _Embedder(cache / 'embeddings', progress, total)
        for drives in evaluated.values():
            if method.fitted:
                found += _search_fitted(method, drives, embed, protocol)
                continue
            made = [embed(method.encoder_for(drive), drive) for drive in drives]
            for mapped, query in itertools.permutations(made, 2):
                found += _search(method.name, mapped, query, protocol)
            for spacing_m in protocol.map_spacings_m:
                key = (drives[0].group, spacing_m)
                ablations.setdefault(key, []).extend(_ablations(method.name, made, spacing_m, protocol))
        if not method.fitted:
            made = [embed(method.encoder_for(drive), drive) for drive in clean]
            validation = np.sort(np.concatenate([m.uncertainties for m in made])).tolist()
    info = method.encoder_for(next(iter(evaluated.values()))[-1]).info
    return Measured(method.name, method.weights, method.fitted, info, found, ablations, validation)


class _Embedder:
    """Embeds drives, and tells one bar of all scans."""

    def __init__(self, folder: Path, progress: Callable[[int, int], None], total: int) -> None:
        self._folder, self._progress, self._total, self._done = folder, progress, total, 0

    def __call__(self, encoder: Encoder, drive: CachedDrive) -> EmbeddedDrive:
        made = embedded(encoder, drive, self._folder, lambda done, _: self._progress(self._done + done, self._total))
        self._done += len(drive)
        self._progress(self._done, self._total)
        return made


def _search_fitted(
    method: Method, drives: Sequence[CachedDrive], embed: _Embedder, protocol: Protocol
) -> Iterator[Answers]:
    for mapped in drives:
        encoder = method.encoder_for(mapped)
        made = embed(encoder, mapped)
        for query in drives:
            if query is not mapped:
                yield from _search(method.name, made, embed(encoder, query), protocol)


def _search(method: str, mapped: EmbeddedDrive, query: EmbeddedDrive, protocol: Protocol) -> Iterator[Answers]:
    for spacing_m in protocol.map_spacings_m:
        drive = mapped.drive
        pair = Pair(method, drive.group, drive.world, drive.index, query.drive.index, spacing_m)
        yield answers_from(pair, mapped, query, protocol.tolerance_m)


def _ablations(
    method: str, drives: Sequence[EmbeddedDrive], spacing_m: float, protocol: Protocol
) -> Iterator[Ablation]:
    if len(drives) < 3:
        return
    for mapped, merged, query in rotations(drives):
        drive = mapped.drive
        pair = Pair(method, drive.group, drive.world, drive.index, query.drive.index, spacing_m)
        yield ablate(pair, mapped, merged, query, protocol.maintenance, protocol.tolerance_m, protocol.seed)
