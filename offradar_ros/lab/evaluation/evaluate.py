"""One evaluation, from a protocol to a folder of results."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from offradar_ros.config import EncoderConfig, QueryConfig
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.evaluation.alignments import AlignedPair, Aligning, measure_alignments
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.distances import nearest_m
from offradar_ros.lab.evaluation.extremes import draw_extremes
from offradar_ros.lab.evaluation.failures import draw_failures
from offradar_ros.lab.evaluation.left_out import require_left_out
from offradar_ros.lab.evaluation.methods import OURS, Method, open_method
from offradar_ros.lab.evaluation.overlays import draw_overlays
from offradar_ros.lab.evaluation.plots import draw_rejection_curves, draw_severity
from offradar_ros.lab.evaluation.protocol import VALIDATION, Protocol
from offradar_ros.lab.evaluation.recorded_drives import RecordedSource, recorded_drives
from offradar_ros.lab.evaluation.recorded_uncertainty import RecordedScans, measure_recorded
from offradar_ros.lab.evaluation.results.arrays import map_arrays, scan_rows, write_arrays
from offradar_ros.lab.evaluation.results.assemble import assemble
from offradar_ros.lab.evaluation.results.file import RESULTS_FILE, write_results
from offradar_ros.lab.evaluation.results.results import Results
from offradar_ros.lab.evaluation.results.uncertainty import RecordedUncertainty
from offradar_ros.lab.evaluation.runner import (
    Bar,
    Encodings,
    Measured,
    Worlds,
    drives_by_world,
    drives_of_pair,
    encode_worlds,
    is_searched,
    measure,
)
from offradar_ros.lab.evaluation.simulated_drives import simulated_drives
from offradar_ros.lab.evaluation.thresholds import NOT_DEPLOYED, Deployed

CURVES, PICTURES = 'recall_at_rejection', ('extremes', 'failures', 'alignments', 'severity')
"""Names of picture files: the first shows all methods; the others show one, whose name is appended."""
ALIGNED = 2
"""Queries of each pair of drives that are aligned unless another number is asked for: enough to see what it gives."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Where data is, and how much of the machine is used: the options of `offradar evaluate`.

    Attributes:
        out: folder for the results.
        cache: folder of simulated scans and embeddings.
        command: the command line, as the results record it.
        bar: opens a progress bar.
        streets: folder of the maps and traversals that a protocol names.
        recorded_scans: the recordings on which U of recorded scans is measured.
        note: is called with each note, one line.
        recorded: where the recorded drives of the protocol are.
        encoder: settings of the encoders; its name and weights are those of each method.
        deployed: the threshold in use; NOT_DEPLOYED takes it from the protocol's validation.
        query: with the gate in use, and the coefficients of the probability where they are not those that ship.
        processes: that simulate; 0 for one per core.
        threads: of a learned encoder; 0 for one per core.
        pictures: whether pictures are drawn.
        alignments: most queries of each pair of drives that are aligned with the places found; 0 for none.
    """

    out: Path
    cache: Path
    command: str
    bar: Bar
    streets: Path | None = None
    recorded_scans: RecordedScans | None = None
    note: Callable[[str], None] = print
    recorded: RecordedSource = dataclasses.field(default_factory=RecordedSource)
    encoder: EncoderConfig = dataclasses.field(default_factory=EncoderConfig)
    deployed: Deployed = NOT_DEPLOYED
    query: QueryConfig = dataclasses.field(default_factory=QueryConfig)
    processes: int = 0
    threads: int = 0
    pictures: bool = True
    alignments: int = ALIGNED


def evaluate(protocol: Protocol, methods: Sequence[str], options: Options) -> Results:
    """Measure methods (as `open_method` takes them); writes results.json, scans.npy, maps.npz and pictures.

    Scans that an interrupted evaluation simulated or encoded are read from the cache.
    """
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f'{options.out}: expected a folder for results ({error.strerror})') from None
    if options.recorded_scans:
        options.recorded_scans.open()
    opened = _opened(protocol, methods, options)
    worlds, missing = open_worlds(protocol, options)
    measured = [
        measure(method, worlds, protocol, options.cache, options.bar, options.deployed, options.query)
        for method in opened
    ]
    aligning = Aligning(options.alignments, options.query.verify_candidates)
    aligned = measure_alignments(opened, worlds, protocol, options.cache, options.bar, aligning)
    missing += _noted(options, [*_unmapped(measured[0], worlds), *_without_threshold(measured, options.deployed)])
    rows, maps = scan_rows(measured, worlds), map_arrays(measured)
    results = assemble(
        measured,
        worlds,
        protocol,
        rows,
        maps,
        command=options.command,
        skipped=missing,
        recorded=_recorded(opened, worlds, protocol, options),
        aligned=aligned,
    )
    # Pictures of an earlier evaluation do not show this one.
    for kind in (CURVES, *PICTURES):
        for picture in options.out.glob(f'{kind}*.png'):
            picture.unlink()
    write_arrays(options.out, rows.rows, maps.arrays)
    write_results(options.out / RESULTS_FILE, results)
    if options.pictures:
        _draw(measured, aligned, worlds, protocol, options.out)
    return results


def _recorded(
    opened: Sequence[Method], worlds: Worlds, protocol: Protocol, options: Options
) -> RecordedUncertainty | None:
    """U of recorded scans, if any; a method that is fitted to each map is fitted to the first drive here."""
    if not options.recorded_scans:
        return None
    first = next(iter(worlds.values()))[0]
    encoders = {method.name: method.encoder_for(first) for method in opened}
    return measure_recorded(encoders, options.recorded_scans, protocol.seed, options.bar)


def encode_drives(protocol: Protocol, methods: Sequence[str], options: Options) -> list[Encodings]:
    """Fill the cache with every embedding that `evaluate` needs."""
    opened = _opened(protocol, methods, options)
    worlds, _ = open_worlds(protocol, options)
    return [encode_worlds(method, worlds, protocol, options.cache, options.bar) for method in opened]


def _opened(protocol: Protocol, methods: Sequence[str], options: Options) -> list[Method]:
    spacing_m = protocol.map_spacings_m[0]
    names = [text.partition('=')[0] for text in methods]
    if len(set(names)) < len(names):
        raise ConfigError(f'--method: expected each name once, got {", ".join(names)}')
    return [
        open_method(
            text,
            options.cache,
            seed=protocol.seed,
            spacing_m=spacing_m,
            config=options.encoder,
            threads=options.threads,
        )
        for text in methods
    ]


def _require_searches(worlds: Worlds, protocol: Protocol, missing: Sequence[str]) -> list[str]:
    """Notes on pairs of drives that never come within the tolerance of each other.

    ConfigError where there is no pair to search, or a drive is too short for a part of it to be left out; DataError
    where all pairs are such.
    """
    pairs = [
        (mapped, query)
        for (group, _), drives in worlds.items()
        if group != VALIDATION
        for mapped, query in itertools.product(drives, repeat=2)
        if is_searched(mapped, query, protocol)
    ]
    if not pairs:
        raise ConfigError(
            f'protocol {protocol.name}: expected two drives of a road or more, found none'
            + ''.join(f'; {text}' for text in missing)
        )
    for mapped, _ in pairs:
        require_left_out(protocol, mapped)
    away = {(m.name, q.name): nearest_m(m, q) for m, q in pairs}
    apart = [
        f'{query}: no scan within {protocol.tolerance_m:g} m of {mapped}, the nearest {metres:.0f} m away: other '
        'roads, or positions that do not agree'
        for (mapped, query), metres in away.items()
        if metres > protocol.tolerance_m
    ]
    if len(apart) == len(away):
        raise DataError(apart[0])
    return apart


def open_worlds(protocol: Protocol, options: Options) -> tuple[Worlds, list[str]]:
    """Every drive of the protocol that is available, and notes on what is missing.

    ConfigError where there is no pair of drives to search, DataError where no pair comes within the tolerance.
    """
    simulated = list(simulated_drives(protocol, options.streets))
    recorded = recorded_drives(protocol, options.recorded)
    missing = [*_skipped_streets(protocol, options.streets), *recorded.notes]
    if {VALIDATION} >= {*(planned.group for planned in simulated), *(drive.group for drive in recorded.drives)}:
        _require_searches({}, protocol, missing)
    _noted(options, missing)
    worlds = drives_by_world(simulated, recorded.drives, options.cache, options.bar, options.processes)
    return worlds, missing + _noted(options, _require_searches(worlds, protocol, missing))


def _noted(options: Options, notes: list[str]) -> list[str]:
    for note in notes:
        options.note(note)
    return notes


def _skipped_streets(protocol: Protocol, folder: Path | None) -> list[str]:
    if folder:
        return []
    names = [street.name for group in protocol.groups for street in group.streets]
    return [f'{", ".join(names)}: maps and traversals are not given (--streets)'] if names else []


def _unmapped(measured: Measured, worlds: Worlds) -> Iterator[str]:
    """Notes on drives without a mapped scan, and on drives that never return to a place."""
    by_pair: dict[tuple[str, str, int, int], list[Answers]] = {}
    for answers in measured.answers:
        pair = answers.pair
        by_pair.setdefault((pair.group, pair.world, pair.map_index, pair.query_index), []).append(answers)
    for several in by_pair.values():
        mapped, query = drives_of_pair(several[0].pair, worlds)
        if not any(answers.places for answers in several):
            yield f'{mapped.name}: none of its scans can be mapped'
        if mapped is query and not any(answers.positive.any() for answers in several):
            yield f'{query.name}: never returns to a place'


def _without_threshold(measured: Sequence[Measured], deployed: Deployed) -> Iterator[str]:
    """Notes on methods for whose model the given threshold was not calibrated."""
    for m in measured:
        if not math.isnan(deployed.threshold) and math.isnan(deployed.of(m.model.fingerprint)):
            yield (
                f'{m.method}: the threshold of --params is for model {deployed.model[:12]}, the method is '
                f'{m.model.fingerprint[:12]}: not used'
            )


def _draw(
    measured: Sequence[Measured],
    aligned: Mapping[str, Sequence[AlignedPair]],
    worlds: Worlds,
    protocol: Protocol,
    out: Path,
) -> None:
    found = [answers for m in measured for answers in m.answers]
    draw_rejection_curves(found, protocol, out / f'{CURVES}.png')
    for method in sorted({m.method for m in measured} & {OURS} or {measured[0].method}):
        own = [a for a in found if a.pair.method == method]
        paths = [out / f'{kind}_{method}.png' for kind in PICTURES]
        draw_extremes(own, worlds, paths[0])
        draw_failures(own, worlds, paths[1])
        dense = [one for one in aligned.get(method, ()) if one.pair.spacing_m == protocol.map_spacings_m[0]]
        draw_overlays(dense, worlds, protocol.tolerance_m, paths[2])
        if any(np.isfinite(a.severities).any() for a in own):
            draw_severity(own, paths[3])
