"""Aligns some queries of each pair of drives with the nearest places of each map."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from offradar_ros.calibration.drive_signatures import DriveSignatures
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.aligned import AlignedAnswers, AlignedMap, drawn_rows
from offradar_ros.lab.evaluation.answers import Pair, map_rows
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive, cached_embeddings
from offradar_ros.lab.evaluation.left_out import maps_of, rows_in_map, stretch_m
from offradar_ros.lab.evaluation.methods import Method
from offradar_ros.lab.evaluation.protocol import VALIDATION, Protocol
from offradar_ros.lab.evaluation.runner import Bar, Worlds, is_searched


@dataclasses.dataclass(frozen=True, eq=False)
class AlignedPair:
    """The aligned answers to queries of one drive in one map of another."""

    pair: Pair
    answers: AlignedAnswers


@dataclasses.dataclass(frozen=True)
class Aligning:
    """What is aligned.

    Attributes:
        queries: most scans of each ordered pair of drives, drawn by the seed of the protocol; 0 for none.
        places: number of nearest places that each is aligned with; a map of fewer is left out.
    """

    queries: int
    places: int


def measure_alignments(
    methods: Sequence[Method], worlds: Worlds, protocol: Protocol, cache: Path, bar: Bar, aligning: Aligning
) -> dict[str, list[AlignedPair]]:
    """Aligned answers by method, for pairs of different drives, with the maps that `measure` searches.

    All methods and maps have the same queries of a pair of drives. Methods that are fitted to each map are left out:
    no map on a vehicle is made with them. Embeddings are read from `cache`.
    """
    methods = [method for method in methods if not method.fitted]
    found: dict[str, list[AlignedPair]] = {method.name: [] for method in methods}
    searched = {key: _searched(drives, protocol) for key, drives in worlds.items() if key[0] != VALIDATION}
    total = len(methods) * sum(map(len, searched.values()))
    if not aligning.queries or not total:
        return {}
    with bar('aligning') as progress:
        done = 0
        for key, pairs in searched.items():
            drives = worlds[key]
            signatures = DriveSignatures(drives)
            for method in methods:
                made = {drive.index: _embedded(method, drive, cache) for drive in drives}
                for mapped, query in pairs:
                    one, other = made[mapped.index], made[query.index]
                    found[method.name] += _aligned(method.name, one, other, signatures, protocol, aligning)
                    done += 1
                    progress(done, total)
    return found


def _searched(drives: Sequence[Drive], protocol: Protocol) -> list[tuple[Drive, Drive]]:
    return [pair for pair in itertools.permutations(drives, 2) if is_searched(*pair, protocol)]


def _embedded(method: Method, drive: Drive, cache: Path) -> EmbeddedDrive:
    return cached_embeddings(method.encoder_for(drive), drive, cache / 'embeddings', lambda *_: None)


def _aligned(
    method: str,
    mapped: EmbeddedDrive,
    query: EmbeddedDrive,
    signatures: DriveSignatures,
    protocol: Protocol,
    aligning: Aligning,
) -> Iterator[AlignedPair]:
    """The answers of one pair of drives, for each map that is made of the first."""
    drive, stretch = mapped.drive, stretch_m(protocol, mapped.drive)
    rng = np.random.default_rng([protocol.seed, drive.index, query.drive.index])
    asked = drawn_rows(query, aligning.queries, rng)
    for spacing_m, number in itertools.product(protocol.map_spacings_m, maps_of(protocol)):
        rows = rows_in_map(drive, map_rows(mapped, spacing_m), number, stretch)
        if len(rows) < aligning.places or not len(asked):
            continue
        pair = Pair(method, drive.group, drive.world, drive.index, query.drive.index, spacing_m, number)
        made = AlignedMap(mapped, rows, signatures, protocol.tolerance_m, aligning.places)
        yield AlignedPair(pair, made.answers(query, asked))
