"""Table and picture of the demonstration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from offradar_ros.lab.demo.truth import ComparedDrive
from offradar_ros.mapping.stored_map import StoredSession
from offradar_ros.recordings.truth import TOLERANCE_M
from offradar_ros.types import Match, PlaceTable


def print_table(drives: list[ComparedDrive], sessions: Sequence[StoredSession], console: Console) -> None:
    """Print one column per drive; `sessions` are those of the map, in the order of the mapped drives."""
    table = Table('', *(compared.replayed.drive.name for compared in drives), title='Simulated drives of one route')
    for name, cells in (_rows(drives) | _map_rows(drives, sessions)).items():
        table.add_row(name, *cells)
    console.print(table)


def _rows(drives: list[ComparedDrive]) -> dict[str, list[str]]:
    reasons = sorted({o.reason.value for drive in drives for o in drive.replayed.outcomes if not isinstance(o, Match)})
    rejected = [
        Counter(o.reason.value for o in drive.replayed.outcomes if not isinstance(o, Match)) for drive in drives
    ]
    percentiles = [np.percentile(drive.replayed.latencies_s, [50, 99]) * 1e3 for drive in drives]
    searched = [bool(drive.nearest_is_right.any()) for drive in drives]

    def recall(chosen: list[NDArray[np.bool_]]) -> list[str]:
        pairs = zip(drives, chosen, searched, strict=True)
        return [f'{drive.recall(c):.3f} of {int(c.sum())}' if known else '-' for drive, c, known in pairs]

    return {
        'scans': [str(drive.replayed.counts['scans']) for drive in drives],
        'of these, degraded by the simulation': [str(int(drive.degraded.sum())) for drive in drives],
        'unanswered': [str(drive.replayed.counts['unanswered']) for drive in drives],
        'matches': [str(drive.replayed.counts['matches']) for drive in drives],
        **{f'rejected: {reason}': [str(counter[reason]) for counter in rejected] for reason in reasons},
        'rejected with a map, degraded / clean': [_rejected(drive) for drive in drives],
        f'Recall@1 within {TOLERANCE_M:g} m, all scans': recall(
            [np.ones(len(drive.accepted), bool) for drive in drives]
        ),
        'Recall@1 of the matches': recall([drive.accepted for drive in drives]),
        'of these, clean scans': recall([drive.accepted & ~drive.degraded for drive in drives]),
        'of these, degraded scans': recall([drive.accepted & drive.degraded for drive in drives]),
        'Recall@1 of the rejected, if answered': recall([~drive.accepted for drive in drives]),
        'latency, median / p99': [f'{p50:.0f} / {p99:.0f} ms' for p50, p99 in percentiles],
    }


def _rejected(compared: ComparedDrive) -> str:
    rejected = np.array([not isinstance(o, Match) and bool(o.candidates) for o in compared.replayed.outcomes], np.bool_)
    return f'{int((rejected & compared.degraded).sum())} / {int((rejected & ~compared.degraded).sum())}'


def _map_rows(drives: list[ComparedDrive], sessions: Sequence[StoredSession]) -> dict[str, list[str]]:
    reports = iter([session.report for session in sessions])
    merged = [next(reports) if compared.replayed.drive.mapped else None for compared in drives]

    def cells(text: str) -> list[str]:
        return ['-' if report is None else text.format_map(_Formatted(report)) for report in merged]

    return {
        'inserted, replaced, kept': cells('{inserted}, {replaced}, {kept}'),
        'places, before and after': cells('{places_before} → {places_after}'),
        'mean U of the map, before and after': cells('{mean_uncertainty_before} → {mean_uncertainty_after}'),
    }


class _Formatted(dict[str, object]):
    """Values of a report as text."""

    def __getitem__(self, key: str) -> str:
        value = super().__getitem__(key)
        return '-' if value is None else f'{value:.3f}' if isinstance(value, float) else str(value)


def draw_map(places: PlaceTable, compared: ComparedDrive, path: Path) -> None:
    """Draw the map, coloured by U, and the answers of one drive: right and wrong matches, and rejections."""
    figure = Figure(figsize=(12, 8))
    axes = figure.add_axes((0.07, 0.16, 0.84, 0.78))
    drawn = axes.scatter(
        places.positions_m[:, 0], places.positions_m[:, 1], c=places.uncertainties, s=150, cmap='YlOrBr', zorder=1
    )
    figure.colorbar(drawn, label='uncertainty U of the mapped scan (1 on average when calibrated)', shrink=0.7)
    right = compared.accepted & compared.nearest_is_right
    for chosen, marker, colour, size, label in (
        (right, '.', 'limegreen', 22, 'matched to the right place'),
        (
            compared.accepted & ~compared.nearest_is_right,
            'x',
            'red',
            26,
            f'matched to a place over {TOLERANCE_M:g} m away',
        ),
        (~compared.accepted & compared.nearest_is_right, '+', 'black', 30, 'rejected, would have been right'),
        (~compared.accepted & ~compared.nearest_is_right, '+', 'blue', 30, 'rejected, would have been wrong'),
    ):
        east_m, north_m = compared.positions_m[chosen].T
        axes.scatter(east_m, north_m, s=size, c=colour, marker=marker, label=f'{label} ({int(chosen.sum())})', zorder=2)
    east_m, north_m = compared.positions_m[compared.degraded].T
    degraded = f'scan degraded by the simulation ({int(compared.degraded.sum())})'
    axes.scatter(
        east_m, north_m, s=90, edgecolors='dimgrey', facecolors='none', linewidths=0.7, label=degraded, zorder=2
    )
    axes.set(
        aspect='equal',
        xlabel='east, m',
        ylabel='north, m',
        title=f'{compared.replayed.drive.name} searched for in a map of {len(places)} places (simulated)',
        facecolor='whitesmoke',
    )
    figure.legend(loc='lower center', ncols=3, facecolor='whitesmoke')
    FigureCanvasAgg(figure)
    figure.savefig(path)
