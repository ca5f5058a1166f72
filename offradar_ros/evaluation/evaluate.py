"""One evaluation, from a protocol to a folder of results."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from offradar_ros.errors import DataError
from offradar_ros.evaluation.answers import Answers
from offradar_ros.evaluation.drives import drives_of
from offradar_ros.evaluation.extremes import draw_extremes
from offradar_ros.evaluation.figures import draw_rejection_curves, draw_severity
from offradar_ros.evaluation.methods import OURS, open_method
from offradar_ros.evaluation.protocol import Protocol
from offradar_ros.evaluation.recorded import measure_recorded, require_recorded
from offradar_ros.evaluation.results import assemble, scan_rows, write_results
from offradar_ros.evaluation.runner import Bar, Worlds, measure, simulated_worlds
from offradar_ros.evaluation.summary import Json
from offradar_ros.evaluation.targets import recorded_targets, targets


@dataclasses.dataclass(frozen=True)
class Options:
    """Where things are and how much of the machine is used; as `offradar evaluate` explains them."""

    out: Path
    cache: Path
    command: str
    bar: Bar
    real_worlds: Path | None = None
    real_scans: Path | None = None
    processes: int = 0
    threads: int = 0
    pictures: bool = True


def evaluate(protocol: Protocol, methods: Sequence[str], options: Options) -> Json:
    """Measure ``NAME=WEIGHTS`` methods; writes results.json, scans.npy and pictures into `options.out`.

    What an interrupted evaluation simulated and encoded is in the cache, and is not done again.
    """
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f'{options.out}: expected a folder for results ({error.strerror})') from None
    if options.real_scans:
        require_recorded(options.real_scans)
    spacing_m = protocol.map_spacings_m[0]
    opened = [
        open_method(text, options.cache, seed=protocol.seed, spacing_m=spacing_m, threads=options.threads)
        for text in methods
    ]
    drives = list(drives_of(protocol, options.real_worlds))
    worlds = simulated_worlds(drives, options.cache, options.bar, options.processes)
    measured = [measure(method, worlds, protocol, options.cache, options.bar) for method in opened]
    results = assemble(measured, protocol, options.command, skipped_streets(protocol, options.real_worlds))
    results['targets'] = targets(results)
    if options.real_scans:
        first = next(iter(worlds.values()))[0]
        results['recorded'] = {
            method.name: measure_recorded(method.encoder_for(first), options.real_scans, protocol.seed)
            for method in opened
        }
        results['targets'] += recorded_targets(results['recorded'])
    found = [answers for m in measured for answers in m.answers]
    rows, results['pairs'], results['kinds'] = scan_rows(found)
    np.save(options.out / 'scans.npy', rows, allow_pickle=False)
    write_results(options.out / 'results.json', results)
    if options.pictures:
        _draw(found, worlds, protocol, options.out)
    return results


def skipped_streets(protocol: Protocol, real_worlds: Path | None) -> list[str]:
    """What the protocol asks for and cannot be driven without a folder of real worlds."""
    if real_worlds:
        return []
    names = [street.name for group in protocol.groups for street in group.streets]
    return [f'{", ".join(names)}: maps and traversals are not given (--real-worlds)'] if names else []


def _draw(found: Sequence[Answers], worlds: Worlds, protocol: Protocol, out: Path) -> None:
    draw_rejection_curves(found, protocol, out / 'recall_at_rejection.png')
    for method in sorted({a.pair.method for a in found} & {OURS} or {found[0].pair.method}):
        own = [a for a in found if a.pair.method == method]
        draw_severity(own, out / f'severity_{method}.png')
        draw_extremes(own, worlds, out / f'extremes_{method}.png')
