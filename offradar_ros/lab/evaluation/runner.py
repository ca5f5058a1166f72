"""An evaluation from end to end: simulate, encode, search, and keep the answers."""

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

from offradar_ros.encoders.protocol import Encoder, ModelInfo
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import Answers, Pair, Rules, answers_from
from offradar_ros.lab.evaluation.cost import measure_cost
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive, embedded
from offradar_ros.lab.evaluation.maintenance import Ablation, ablate, merges
from offradar_ros.lab.evaluation.methods import Method
from offradar_ros.lab.evaluation.protocol import VALIDATION, Protocol
from offradar_ros.lab.evaluation.results.method import Cost
from offradar_ros.lab.evaluation.simulated_drives import PlannedDrive
from offradar_ros.lab.evaluation.thresholds import NOT_DEPLOYED, Deployed, Thresholds, thresholds_from

ItemT = TypeVar('ItemT')
FoundT = TypeVar('FoundT')

Bar = Callable[[str], AbstractContextManager[Callable[[int, int], None]]]
"""Opens a progress bar of this text: a function of how much is done and how much there is."""

Worlds = dict[tuple[str, str], list[Drive]]
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
        thresholds: from U of the clean validation scans; none likewise.
        cost: of encoding and of searching, as `measure_cost` measures it.
    """

    method: str
    weights: str
    fitted: bool
    model: ModelInfo
    answers: list[Answers]
    ablations: dict[tuple[str, float], list[Ablation]]
    thresholds: Thresholds
    cost: Cost


def opened_worlds(
    simulated: Sequence[PlannedDrive],
    recorded: Sequence[Drive],
    cache: Path,
    bar: Bar,
    processes: int = 0,
) -> Worlds:
    """Every drive with its scans; simulated ones are rendered now or were earlier."""
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
    """The drive that was mapped, and the one that was searched for."""
    by_index = {drive.index: drive for drive in worlds[pair.group, pair.world]}
    return by_index[pair.map_index], by_index[pair.query_index]


def measure(
    method: Method, worlds: Worlds, protocol: Protocol, cache: Path, bar: Bar, deployed: Deployed = NOT_DEPLOYED
) -> Measured:
    """Encode all drives, search every drive's map for every other drive of its world, and maintain maps.

    The threshold in use is the `deployed` one where that is for this model, else that of the validation drives.
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
            asked = [(m, q) for m, q in itertools.product(made, repeat=2) if searched(m.drive, q.drive, protocol)]
            searches = _together(lambda pair: list(_search(method.name, pair[0], pair[1], protocol)), asked)
            for number, spacing_m in enumerate(protocol.map_spacings_m):
                several = _ablations([answers[number] for answers in searches], made, protocol)
                ablations.setdefault((drives[0].group, spacing_m), []).extend(several)
            found += itertools.chain.from_iterable(searches)
        if not method.fitted:
            made = [embed(method.encoder_for(drive), drive) for drive in clean]
            validation = [u for m in made for u in m.uncertainties.tolist()]
    drive = next(d for drives in reversed(evaluated.values()) for d in reversed(drives) if d.mapped)
    encoder = method.encoder_for(drive)
    headline = [answers.places for answers in found if answers.pair.spacing_m == protocol.map_spacings_m[0]]
    return Measured(
        method.name,
        method.weights,
        method.fitted,
        encoder.info,
        found,
        ablations,
        thresholds_from(validation, protocol.validation, deployed.of(encoder.info.fingerprint)),
        measure_cost(encoder, drive, round(np.mean(headline))),
    )


def searched(mapped: Drive, query: Drive, protocol: Protocol) -> bool:
    """Whether one drive's scans are searched for in the map of another, or of its own."""
    return mapped.mapped and query.queried and (mapped is not query or protocol.exclusion_s > 0.0)


class Encodings(NamedTuple):
    """How much one method encoded, now or earlier, and how many of the scans it refused."""

    method: str
    drives: int
    scans: int
    refused: int


def encode_all(method: Method, worlds: Worlds, protocol: Protocol, cache: Path, bar: Bar) -> Encodings:
    """Everything that `measure` would encode; for a method that is fitted to maps, once for each map."""
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
    """Whose map's encoder is used, and for which drive."""
    for (group, _), drives in worlds.items():
        if not method.fitted:
            yield from ((drive, drive) for drive in drives)
        elif group != VALIDATION:
            yield from ((drive, drive) for drive in drives if drive.mapped)
            yield from ((m, q) for m, q in itertools.permutations(drives, 2) if searched(m, q, protocol))


class _Embedder:
    """Embeds drives, with one progress bar for all scans."""

    def __init__(self, folder: Path, progress: Callable[[int, int], None], total: int) -> None:
        self._folder, self._progress, self._total, self._done = folder, progress, total, 0

    def __call__(self, encoder: Encoder, drive: Drive) -> EmbeddedDrive:
        made = embedded(encoder, drive, self._folder, lambda done, _: self._progress(self._done + done, self._total))
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
            if searched(mapped, query, protocol):
                asked = made if query is mapped else embed(encoder, query)
                yield from _search(method.name, made, asked, protocol)


def _search(method: str, mapped: EmbeddedDrive, query: EmbeddedDrive, protocol: Protocol) -> Iterator[Answers]:
    for spacing_m in protocol.map_spacings_m:
        yield answers_from(_pair(method, mapped, query, spacing_m), mapped, query, _rules(protocol, mapped is query))


def _pair(method: str, mapped: EmbeddedDrive, query: EmbeddedDrive, spacing_m: float) -> Pair:
    drive = mapped.drive
    return Pair(method, drive.group, drive.world, drive.index, query.drive.index, spacing_m)


def _rules(protocol: Protocol, own: bool = False) -> Rules:
    """Of a search through a drive's `own` map, or another's."""
    return Rules(protocol.tolerance_m, protocol.negative_m, round(protocol.exclusion_s * 1e9) if own else 0)


def _ablations(found: Sequence[Answers], drives: Sequence[EmbeddedDrive], protocol: Protocol) -> list[Ablation]:
    """Of every search that was `found` in the map of another drive, where there are more drives to merge."""
    by_pair = {(answers.pair.map_index, answers.pair.query_index): answers for answers in found}

    def one(turn: tuple[EmbeddedDrive, list[EmbeddedDrive], EmbeddedDrive]) -> Ablation:
        mapped, merged, query = turn
        unmaintained = by_pair[mapped.drive.index, query.drive.index]
        plan, rules = protocol.maintenance, _rules(protocol)
        return ablate(unmaintained, mapped, merged, query, plan, rules, protocol.seed)

    return _together(one, merges(drives))


def _together(function: Callable[[ItemT], FoundT], items: Iterable[ItemT]) -> list[FoundT]:
    """Results in the order of the items; NumPy lets several threads compute at once."""
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(function, items))
