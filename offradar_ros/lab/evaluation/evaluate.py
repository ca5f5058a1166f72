"""One evaluation, from a protocol to a folder of results."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from offradar_ros.config import EncoderConfig
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.evaluation.extremes import draw_extremes
from offradar_ros.lab.evaluation.failures import draw_failures
from offradar_ros.lab.evaluation.figures import draw_rejection_curves, draw_severity
from offradar_ros.lab.evaluation.methods import OURS, Method, open_method
from offradar_ros.lab.evaluation.nearness import nearest_m
from offradar_ros.lab.evaluation.protocol import VALIDATION, Protocol
from offradar_ros.lab.evaluation.recorded import measure_recorded, require_recorded
from offradar_ros.lab.evaluation.recorded_drives import RecordedSource, recorded_drives
from offradar_ros.lab.evaluation.results import (
    RESULTS_FILE,
    assemble,
    map_arrays,
    scan_rows,
    write_arrays,
    write_results,
)
from offradar_ros.lab.evaluation.runner import (
    Bar,
    Encodings,
    Measured,
    Worlds,
    drives_of_pair,
    encode_all,
    measure,
    opened_worlds,
    searched,
)
from offradar_ros.lab.evaluation.simulated_drives import simulated_drives
from offradar_ros.lab.evaluation.summary import Json
from offradar_ros.lab.evaluation.targets import recorded_targets, targets
from offradar_ros.lab.evaluation.thresholds import NOT_DEPLOYED, Deployed

CURVES, PICTURES = 'recall_at_rejection', ('extremes', 'failures', 'severity')
"""Pictures: the first of all methods, the others of one, whose name follows."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Where things are and how much of the machine is used; as `offradar evaluate` explains them.

    `say` hears, as it comes, what is worth a note. `deployed` is the threshold in use where it is not to come from the
    protocol's validation.
    """

    out: Path
    cache: Path
    command: str
    bar: Bar
    real_worlds: Path | None = None
    real_scans: Path | None = None
    say: Callable[[str], None] = print
    recorded: RecordedSource = dataclasses.field(default_factory=RecordedSource)
    encoder: EncoderConfig = dataclasses.field(default_factory=EncoderConfig)
    deployed: Deployed = NOT_DEPLOYED
    processes: int = 0
    threads: int = 0
    pictures: bool = True


def evaluate(protocol: Protocol, methods: Sequence[str], options: Options) -> Json:
    """Measure ``NAME=WEIGHTS`` methods; writes results.json, scans.npy, maps.npz and pictures into `options.out`.

    What an interrupted evaluation simulated and encoded is in the cache, and is not done again.
    """
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f'{options.out}: expected a folder for results ({error.strerror})') from None
    if options.real_scans:
        require_recorded(options.real_scans)
    opened = _opened(protocol, methods, options)
    worlds, lacking = open_worlds(protocol, options)
    measured = [measure(method, worlds, protocol, options.cache, options.bar, options.deployed) for method in opened]
    lacking += _told(options, [*_unmapped(measured[0], worlds), *_without_threshold(measured, options.deployed)])
    results = assemble(measured, worlds, protocol, options.command, lacking)
    results['targets'] = targets(results) if protocol.targets else []
    if options.real_scans:
        first = next(iter(worlds.values()))[0]
        results['recorded'] = {
            method.name: measure_recorded(method.encoder_for(first), options.real_scans, protocol.seed)
            for method in opened
        }
        results['targets'] += recorded_targets(results['recorded'])
    rows, results['pairs'], results['kinds'] = scan_rows(measured, worlds)
    arrays, results['maps'] = map_arrays(measured)
    # Pictures of an earlier evaluation are not of this one.
    for kind in (CURVES, *PICTURES):
        for picture in options.out.glob(f'{kind}*.png'):
            picture.unlink()
    write_arrays(options.out, rows, arrays)
    write_results(options.out / RESULTS_FILE, {**results, 'rows': len(rows)})
    if options.pictures:
        _draw(measured, worlds, protocol, options.out)
    return results


def encode_drives(protocol: Protocol, methods: Sequence[str], options: Options) -> list[Encodings]:
    """Fill the cache with every embedding that `evaluate` would ask for."""
    opened = _opened(protocol, methods, options)
    worlds, _ = open_worlds(protocol, options)
    return [encode_all(method, worlds, protocol, options.cache, options.bar) for method in opened]


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


def _require_searches(worlds: Worlds, protocol: Protocol, lacking: Sequence[str]) -> list[str]:
    """ConfigError where nothing can be searched, DataError where nothing can be found; pairs that never meet."""
    pairs = [
        (mapped, query)
        for (group, _), drives in worlds.items()
        if group != VALIDATION
        for mapped, query in itertools.product(drives, repeat=2)
        if searched(mapped, query, protocol)
    ]
    if not pairs:
        raise ConfigError(
            f'protocol {protocol.name}: expected two drives of a road or more, found none'
            + ''.join(f'; {text}' for text in lacking)
        )
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
    """Every drive of the protocol that there is, and in words what there is not, which is told before anything is made.

    ConfigError where nothing can be searched, DataError where no drives that are searched ever meet.
    """
    simulated = list(simulated_drives(protocol, options.real_worlds))
    recorded = recorded_drives(protocol, options.recorded)
    lacking = [*_skipped_streets(protocol, options.real_worlds), *recorded.notes]
    if {VALIDATION} >= {*(planned.group for planned in simulated), *(drive.group for drive in recorded.drives)}:
        _require_searches({}, protocol, lacking)
    _told(options, lacking)
    worlds = opened_worlds(simulated, recorded.drives, options.cache, options.bar, options.processes)
    return worlds, lacking + _told(options, _require_searches(worlds, protocol, lacking))


def _told(options: Options, notes: list[str]) -> list[str]:
    for note in notes:
        options.say(note)
    return notes


def _skipped_streets(protocol: Protocol, real_worlds: Path | None) -> list[str]:
    if real_worlds:
        return []
    names = [street.name for group in protocol.groups for street in group.streets]
    return [f'{", ".join(names)}: maps and traversals are not given (--real-worlds)'] if names else []


def _unmapped(measured: Measured, worlds: Worlds) -> Iterator[str]:
    """Drives of which no scan is mapped, and those that never come back to where they were."""
    told = {(a.pair.group, a.pair.world, a.pair.map_index, a.pair.query_index): a for a in measured.answers}
    for answers in told.values():
        mapped, query = drives_of_pair(answers.pair, worlds)
        if not answers.places:
            yield f'{mapped.name}: none of its scans can be mapped'
        if mapped is query and not answers.positive.any():
            yield f'{query.name}: never comes back to where it was'


def _without_threshold(measured: Sequence[Measured], deployed: Deployed) -> Iterator[str]:
    """Methods whose model the threshold that was given is not for."""
    for m in measured:
        if not math.isnan(deployed.threshold) and math.isnan(deployed.of(m.model.fingerprint)):
            yield (
                f'{m.method}: the threshold of --params is for model {deployed.model[:12]}, this is '
                f'{m.model.fingerprint[:12]}: not used'
            )


def _draw(measured: Sequence[Measured], worlds: Worlds, protocol: Protocol, out: Path) -> None:
    found = [answers for m in measured for answers in m.answers]
    draw_rejection_curves(found, protocol, out / f'{CURVES}.png')
    for method in sorted({m.method for m in measured} & {OURS} or {measured[0].method}):
        own = [a for a in found if a.pair.method == method]
        paths = [out / f'{kind}_{method}.png' for kind in PICTURES]
        draw_extremes(own, worlds, paths[0])
        draw_failures(own, worlds, paths[1])
        if any(np.isfinite(a.severities).any() for a in own):
            draw_severity(own, paths[2])
