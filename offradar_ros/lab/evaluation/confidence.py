"""Fits and measures the probability that an answer is right, on open sets of simulated or recorded drives."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros.bounded_input import parse_yaml
from offradar_ros.calibration.aligned_places import AlignedPlaces, joined_places
from offradar_ros.calibration.confidence_fit import fit_confidence, fit_verified, scales_of
from offradar_ros.calibration.open_set import joined_evidence
from offradar_ros.config import ConfidenceConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import ConfigError
from offradar_ros.lab.evaluation.aligned import answers_of_worlds
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.evaluate import Options, open_worlds
from offradar_ros.lab.evaluation.methods import open_method
from offradar_ros.lab.evaluation.open_set import OpenSet, open_sets, other_roads
from offradar_ros.lab.evaluation.protocol import VALIDATION, Protocol
from offradar_ros.lab.evaluation.runner import embedded_worlds
from offradar_ros.retrieval.confidence import terms_of
from offradar_ros.retrieval.evidence import EvidenceTable
from offradar_ros.whole_file import write_whole_file
from offradar_ros.yaml_digest import digest_line


@dataclasses.dataclass(frozen=True)
class Setting:
    """Maps of one kind.

    Attributes:
        spacing_m: path length between two places.
        added: how many drives of each other world are added to a map; 0 for none.
    """

    spacing_m: float
    added: int

    def __str__(self) -> str:
        return f'a map every {self.spacing_m:g} m' + (', other towns added' if self.added else '')


def settings(protocol: Protocol, drives: int) -> list[Setting]:
    """Every map spacing of the protocol, each without other towns, with one drive of each, and with all `drives`."""
    added = sorted({0, 1, drives})
    return [Setting(*pair) for pair in itertools.product(protocol.map_spacings_m, added)]


Embedded = dict[tuple[str, str], list[EmbeddedDrive]]
"""Embedded drives by group and world."""


def embed(protocol: Protocol, method: str, options: Options) -> tuple[ModelInfo, Embedded]:
    """The model of a method and the drives of a protocol, embedded or read from the cache.

    ConfigError for a method that is fitted to each map: its distances in two maps do not compare.
    """
    opened = open_method(
        method,
        options.cache,
        seed=protocol.seed,
        spacing_m=protocol.map_spacings_m[0],
        config=options.encoder,
        threads=options.threads,
    )
    if opened.fitted:
        raise ConfigError(f'--method {method}: expected an encoder that is not fitted to each map')
    worlds, _ = open_worlds(protocol, options)
    worlds = {key: drives for key, drives in worlds.items() if key[0] != VALIDATION}
    embedded = embedded_worlds(opened, worlds, options.cache, options.bar)
    first = next(iter(worlds.values()))[0]
    return opened.encoder_for(first).info, embedded


def open_sets_of(
    worlds: Embedded, setting: Setting, tolerance_m: float, more: Sequence[Sequence[EmbeddedDrive]] = ()
) -> Iterator[OpenSet]:
    """The open sets of every world, with maps of this kind, to each of which the drives of `more` worlds are added."""
    for key, drives in worlds.items():
        others = [some[: setting.added] for other, some in worlds.items() if other != key and setting.added]
        added = other_roads([*others, *more], ADDED_SPACING_M) if others or more else None
        yield from open_sets(drives, setting.spacing_m, tolerance_m, added)


ADDED_SPACING_M = 5.0
"""Path length between two places of roads that are added to a map."""


def joined(sets: Sequence[OpenSet]) -> tuple[EvidenceTable, NDArray[np.bool_]]:
    """The evidence of all queries, and whether each answer is right."""
    return joined_evidence([one.evidence for one in sets]), np.concatenate([one.right for one in sets])


def fit(protocol: Protocol, method: str, options: Options) -> ConfidenceConfig:
    """Coefficients for a method, of all kinds of maps with equal weight."""
    info, worlds = embed(protocol, method, options)
    kinds = settings(protocol, max(len(drives) for drives in worlds.values()))
    made = [joined(list(open_sets_of(worlds, kind, protocol.tolerance_m))) for kind in kinds]
    scales = scales_of(made[0][0], info.fingerprint)
    terms = np.concatenate([terms_of(evidence, scales) for evidence, _ in made])
    right = np.concatenate([right for _, right in made])
    weights = np.concatenate([np.full(len(right), 1.0 / len(right)) for _, right in made])
    return fit_confidence(terms, right, weights, scales)


def fit_alignments(
    protocol: Protocol, method: str, options: Options, found: ConfidenceConfig, places: int, queries: int
) -> ConfidenceConfig:
    """`found` with the coefficients of alignments, of maps of every spacing with equal weight.

    `queries` of each drive, drawn by the seed of the protocol, are aligned with the nearest `places` of each map.
    """
    _, worlds = embed(protocol, method, options)
    made: list[AlignedPlaces] = []
    with options.bar('aligning') as progress:
        for number, drives in enumerate(worlds.values()):
            found_here = answers_of_worlds([drives], protocol, protocol.map_spacings_m, places=places, queries=queries)
            made += [answers.judged(protocol.tolerance_m) for answers in found_here]
            progress(number + 1, len(worlds))
    weights = np.concatenate([np.full(len(one), 1.0 / len(one)) for one in made])
    return fit_verified(joined_places(made), weights, found)


def write_confidence(path: Path, found: ConfidenceConfig, comment: str) -> None:
    """Write coefficients as the package ships them (``params/confidence``); ConfigError if they cannot be written."""
    lines = []
    for field in dataclasses.fields(found):
        value = getattr(found, field.name)
        shown = f'{value!r}' if isinstance(value, float) else f"'{value}'"
        lines += [f'# {field.metadata["bounds"].description}', f'{field.name}: {shown}']
    text = '\n'.join(lines) + '\n'
    try:
        write_whole_file(path, f'# {comment}\n{digest_line(parse_yaml(text))}{text}'.encode())
    except OSError as error:
        raise ConfigError(f'{path}: cannot be written ({error.strerror})') from error
