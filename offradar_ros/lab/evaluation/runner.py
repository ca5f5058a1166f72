"""The steps of an evaluation: simulate, encode, search, maintain maps."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from offradar_ros.config import QueryConfig
from offradar_ros.encoders.protocol import Encoder, ModelInfo
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import Answers, Pair, Rules, search_drive_map
from offradar_ros.lab.evaluation.cost import measure_cost
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive, cached_embeddings
from offradar_ros.lab.evaluation.gate import Gate, gate_of
from offradar_ros.lab.evaluation.left_out import maps_of, stretch_m
from offradar_ros.lab.evaluation.maintenance import Ablation, ablate, merge_plans
from offradar_ros.lab.evaluation.methods import Method
from offradar_ros.lab.evaluation.protocol import VALIDATION, Protocol
from offradar_ros.lab.evaluation.results.method import Cost
from offradar_ros.lab.evaluation.simulated_drives import PlannedDrive
from offradar_ros.lab.evaluation.thresholds import NOT_DEPLOYED, Deployed, Thresholds, thresholds_from

DEFAULT_QUERY = QueryConfig()
ItemT = TypeVar('ItemT')
FoundT = TypeVar('FoundT')

Bar = Callable[[str], AbstractContextManager[Callable[[int, int], None]]]
"""Opens a progress bar with a text; it yields a function of (done, total)."""

Worlds = dict[tuple[str, str], list[Drive]]
"""Drives by group and world."""


@dataclasses.dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of one method.

    Attributes:
        method: its name.
        weights: file of its weights, if any.
        fitted: whether the encoder is fitted to each map.
        model: the encoder; that of one of the maps if it is fitted to each.
        answers: of all ordered pairs of drives of each world, for each map spacing and each of `left_out.maps_of`.
        ablations: by group and map spacing; none for a method that is fitted to each map, or where a part of each map
            is left out.
        thresholds: from U of the validation drives; none for a method that is fitted to each map.
        gate: which decides what is answered.
        cost: of encoding and searching, from `measure_cost`.
    """

    method: str
    weights: str
    fitted: bool
    model: ModelInfo
    answers: list[Answers]
    ablations: dict[tuple[str, float], list[Ablation]]
    thresholds: Thresholds
    gate: Gate
    cost: Cost


def drives_by_world(
    simulated: Sequence[PlannedDrive],
    recorded: Sequence[Drive],
    cache: Path,
    bar: Bar,
    processes: int = 0,
) -> Worlds:
    """All drives by group and world; simulated ones are rendered, or read from `cache`."""
    found: list[Drive] = []
    if simulated:
        with bar('simulating drives') as progress:
            sources = [planned.source for planned in simulated]
            made = cached_drives(sources, cache / 'scans', processes=processes, progress=progress)
        pairs = zip(simulated, made, strict=True)
        found = [dataclasses.replace(drive, group=planned.group, index=planned.index) for planned, drive in pairs]
    worlds: Worlds = {}
    for drive in (*found, *recorded):
        worlds.setdefault((drive.group, drive.world), []).append(drive)
    return worlds


def drives_of_pair(pair: Pair, worlds: Worlds) -> tuple[Drive, Drive]:
    """(mapped drive, query drive) of a pair."""
    by_index = {drive.index: drive for drive in worlds[pair.group, pair.world]}
    return by_index[pair.map_index], by_index[pair.query_index]


def measure(
    method: Method,
    worlds: Worlds,
    protocol: Protocol,
    cache: Path,
    bar: Bar,
    deployed: Deployed = NOT_DEPLOYED,
    query: QueryConfig = DEFAULT_QUERY,
) -> Measured:
    """Encode all drives, search the map of every drive for the other drives of its world, and maintain maps.

    The threshold in use is the `deployed` one if it is for this model, else that of the validation drives; `query` has
    the gate in use.
    """
    evaluated = {key: drives for key, drives in worlds.items() if key[0] != VALIDATION}
    clean = [drive for (group, _), drives in worlds.items() if group == VALIDATION for drive in drives]
    found: list[Answers] = []
    ablations: dict[tuple[str, float], list[Ablation]] = {}
    validation: list[float] = []
    total = sum(len(drive) for _, drive in _encoded(method, worlds, protocol))
    with bar(f'{method.name}: encoding') as progress:
        embed = _Embedder(cache / 'embeddings', progress, total)
        for drives in evaluated.values():
            if method.fitted:
                found += _search_fitted(method, drives, embed, protocol)
                continue
            made = [embed(method.encoder_for(drive), drive) for drive in drives]
            pairs = [(m, q) for m, q in itertools.product(made, repeat=2) if is_searched(m.drive, q.drive, protocol)]
            searches = _in_parallel(lambda pair: list(_search(method.name, pair[0], pair[1], protocol)), pairs)
            for number, spacing_m in enumerate(() if protocol.leaves_out else protocol.map_spacings_m):
                several = _ablations([answers[number] for answers in searches], made, protocol)
                ablations.setdefault((drives[0].group, spacing_m), []).extend(several)
            found += itertools.chain.from_iterable(searches)
        if not method.fitted:
            made = [embed(method.encoder_for(drive), drive) for drive in clean]
            validation = [u for m in made for u in m.uncertainties.tolist()]
    drive = next(d for drives in reversed(evaluated.values()) for d in reversed(drives) if d.mapped)
    encoder = method.encoder_for(drive)
    fingerprint = encoder.info.fingerprint
    thresholds = thresholds_from(validation, protocol.validation, deployed.of(fingerprint))
    headline = [answers.places for answers in found if answers.pair.spacing_m == protocol.map_spacings_m[0]]
    return Measured(
        method.name,
        method.weights,
        method.fitted,
        encoder.info,
        found,
        ablations,
        thresholds,
        gate_of(query, fingerprint, thresholds.deployed),
        measure_cost(encoder, drive, round(np.mean(headline))),
    )


def is_searched(mapped: Drive, query: Drive, protocol: Protocol) -> bool:
    """Whether the scans of `query` are searched for in the map of `mapped`."""
    return mapped.mapped and query.queried and (mapped is not query or protocol.exclusion_s > 0.0)


def embedded_worlds(
    method: Method, worlds: Worlds, cache: Path, bar: Bar
) -> dict[tuple[str, str], list[EmbeddedDrive]]:
    """Every drive, encoded by a method that is not fitted to maps, or read from the cache."""
    with bar(f'{method.name}: encoding') as progress:
        embed = _Embedder(
            cache / 'embeddings', progress, sum(len(drive) for drives in worlds.values() for drive in drives)
        )
        return {key: [embed(method.encoder_for(drive), drive) for drive in drives] for key, drives in worlds.items()}


class Encodings(NamedTuple):
    """Numbers of drives and scans that one method encoded, now or earlier, and of scans that it refused."""

    method: str
    drives: int
    scans: int
    refused: int


def encode_worlds(method: Method, worlds: Worlds, protocol: Protocol, cache: Path, bar: Bar) -> Encodings:
    """Encode every scan that `measure` needs; if the method is fitted to maps, once for each map."""
    pairs = list(_encoded(method, worlds, protocol))
    done = refused = 0
    with bar(f'{method.name}: encoding') as progress:
        embed = _Embedder(cache / 'embeddings', progress, sum(len(drive) for _, drive in pairs))
        for mapped, drive in pairs:
            made = embed(method.encoder_for(mapped), drive)
            done += len(drive)
            refused += int((~made.usable).sum())
    return Encodings(method.name, len({drive.key for _, drive in pairs}), done, refused)


def _encoded(method: Method, worlds: Worlds, protocol: Protocol) -> Iterator[tuple[Drive, Drive]]:
    """(mapped drive, encoded drive): the encoder is that of the map of the first."""
    for (group, _), drives in worlds.items():
        if not method.fitted:
            yield from ((drive, drive) for drive in drives)
        elif group != VALIDATION:
            yield from ((drive, drive) for drive in drives if drive.mapped)
            yield from ((m, q) for m, q in itertools.permutations(drives, 2) if is_searched(m, q, protocol))


class _Embedder:
    """Embeds drives and reports progress over the scans of all of them."""

    def __init__(self, folder: Path, progress: Callable[[int, int], None], total: int) -> None:
        self._folder, self._progress, self._total, self._done = folder, progress, total, 0

    def __call__(self, encoder: Encoder, drive: Drive) -> EmbeddedDrive:
        made = cached_embeddings(
            encoder, drive, self._folder, lambda done, _: self._progress(self._done + done, self._total)
        )
        self._done += len(drive)
        self._progress(self._done, self._total)
        return made


def _search_fitted(method: Method, drives: Sequence[Drive], embed: _Embedder, protocol: Protocol) -> Iterator[Answers]:
    for mapped in drives:
        if not mapped.mapped:
            continue
        encoder = method.encoder_for(mapped)
        made = embed(encoder, mapped)
        for query in drives:
            if is_searched(mapped, query, protocol):
                queries = made if query is mapped else embed(encoder, query)
                yield from _search(method.name, made, queries, protocol)


def _search(method: str, mapped: EmbeddedDrive, query: EmbeddedDrive, protocol: Protocol) -> Iterator[Answers]:
    drive, rules, stretch = mapped.drive, _rules(protocol, mapped is query), stretch_m(protocol, mapped.drive)
    for spacing_m, number in itertools.product(protocol.map_spacings_m, maps_of(protocol)):
        pair = Pair(method, drive.group, drive.world, drive.index, query.drive.index, spacing_m, number)
        yield search_drive_map(pair, mapped, query, rules, stretch)


def _rules(protocol: Protocol, own: bool = False) -> Rules:
    """The rules of a search; the exclusion holds in a drive's `own` map only."""
    return Rules(protocol.tolerance_m, protocol.negative_m, round(protocol.exclusion_s * 1e9) if own else 0)


def _ablations(found: Sequence[Answers], drives: Sequence[EmbeddedDrive], protocol: Protocol) -> list[Ablation]:
    """The ablation of every pair of drives for which there are other drives to merge."""
    by_pair = {(answers.pair.map_index, answers.pair.query_index): answers for answers in found}

    def one(plan: tuple[EmbeddedDrive, list[EmbeddedDrive], EmbeddedDrive]) -> Ablation:
        mapped, merged, query = plan
        unmaintained = by_pair[mapped.drive.index, query.drive.index]
        return ablate(unmaintained, mapped, merged, query, protocol.maintenance, _rules(protocol), protocol.seed)

    return _in_parallel(one, merge_plans(drives))


def _in_parallel(function: Callable[[ItemT], FoundT], items: Iterable[ItemT]) -> list[FoundT]:
    """Results in the order of the items, computed in threads: NumPy releases the GIL."""
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(function, items))
