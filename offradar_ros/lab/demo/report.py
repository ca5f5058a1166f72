"""Table of the demonstration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from offradar_ros.lab.demo.truth import ComparedDrive
from offradar_ros.mapping.stored_map import StoredSession
from offradar_ros.recordings.truth import TOLERANCE_M, recall_at_1
from offradar_ros.types import LocalisationState, Match

_Rows = dict[str, list[str]]


def print_table(drives: list[ComparedDrive], sessions: Sequence[StoredSession], console: Console) -> None:
    """Print one column per drive; `sessions` are those of the map, in the order of the mapped drives."""
    names = [compared.replayed.drive.name for compared in drives]
    table = Table('', *names, title='Simulated drives of one city')
    sections = {
        'all scans': _scan_rows(drives),
        f'on the map: a place within {TOLERANCE_M:g} m': _on_map_rows(drives),
        'off the map': _off_map_rows(drives),
        "the paper's rule, a threshold on U alone": _paper_rows(drives),
        'the belief over many scans': _belief_rows(drives),
        'the map': _map_rows(drives, sessions),
    }
    for title, rows in sections.items():
        table.add_section()
        table.add_row(f'[bold]{title}')
        for name, cells in rows.items():
            table.add_row(f'  {name}', *cells)
    console.print(table)


def what_rejection_saves(compared: ComparedDrive) -> str:
    """One sentence: how many scans off the map were answered, and how many the paper's rule would have answered."""
    off = compared.off_map
    return (
        f'{_count(off)} scans of {compared.replayed.drive.name} are off the map, where each answer is wrong: '
        f"{_count(off & compared.accepted)} were answered; the paper's rule on U would have answered "
        f'{_count(off & compared.paper_accepts)}.'
    )


def _scan_rows(drives: list[ComparedDrive]) -> _Rows:
    return {
        'scans': [str(drive.replayed.counts['scans']) for drive in drives],
        'degraded by the simulation': [str(_count(drive.degraded)) for drive in drives],
        'unanswered': [str(drive.replayed.counts['unanswered']) for drive in drives],
        'matches': [str(drive.replayed.counts['matches']) for drive in drives],
        **_reasons(drives, [np.ones(len(drive.accepted), np.bool_) for drive in drives]),
        'latency, median / p99': [_latency(drive) for drive in drives],
    }


def _on_map_rows(drives: list[ComparedDrive]) -> _Rows:
    rejected = [drive.on_map & ~drive.accepted for drive in drives]
    return {
        'Recall@1, if all were answered': [_recall(drive) for drive in drives],
        'matches, right / wrong': [
            _pair(drive, drive.on_map & drive.accepted, drive.nearest_is_right) for drive in drives
        ],
        'rejected, would be right / wrong': [
            _pair(d, r, d.nearest_is_right) for d, r in zip(drives, rejected, strict=True)
        ],
        'rejected, degraded / clean': [_pair(d, r, d.degraded) for d, r in zip(drives, rejected, strict=True)],
    }


def _off_map_rows(drives: list[ComparedDrive]) -> _Rows:
    return {
        'matches, each wrong': [_share(drive.off_map, drive.accepted) for drive in drives],
        **_reasons(drives, [drive.off_map for drive in drives]),
    }


def _paper_rows(drives: list[ComparedDrive]) -> _Rows:
    on_map = [_pair(drive, drive.on_map & drive.paper_accepts, drive.nearest_is_right) for drive in drives]
    return {
        'matches on the map, right / wrong': on_map,
        'matches off the map, each wrong': [_share(drive.off_map, drive.paper_accepts) for drive in drives],
    }


def _belief_rows(drives: list[ComparedDrive]) -> _Rows:
    """How many scans after which the belief was in each state, on the map and off it."""
    return {
        f'{state.value}, scans on / off the map': [
            f'{_count(found & drive.on_map)} / {_count(found & drive.off_map)}' if drive.searched else '-'
            for drive in drives
            for found in [drive.states == state.value]
        ]
        for state in LocalisationState
    }


def _reasons(drives: list[ComparedDrive], chosen: list[NDArray[np.bool_]]) -> _Rows:
    """Rejections of the chosen scans of each drive, by reason."""
    counts = []
    for drive, scans in zip(drives, chosen, strict=True):
        pairs = zip(drive.replayed.outcomes, scans.tolist(), strict=True)
        counts.append(Counter(outcome.reason.value for outcome, c in pairs if c and not isinstance(outcome, Match)))
    reasons = sorted({reason for counter in counts for reason in counter})
    return {
        f'rejected: {reason}': [str(n[reason]) if scans.any() else '-' for n, scans in zip(counts, chosen, strict=True)]
        for reason in reasons
    }


def _recall(drive: ComparedDrive) -> str:
    errors_m = drive.errors_m[drive.on_map]
    return f'{recall_at_1(errors_m):.3f} of {len(errors_m)}' if len(errors_m) else '-'


def _count(chosen: NDArray[np.bool_]) -> int:
    return int(np.sum(chosen))


def _pair(drive: ComparedDrive, chosen: NDArray[np.bool_], of: NDArray[np.bool_]) -> str:
    return f'{_count(chosen & of)} / {_count(chosen & ~of)}' if drive.searched else '-'


def _share(scans: NDArray[np.bool_], chosen: NDArray[np.bool_]) -> str:
    return f'{_count(scans & chosen)} of {_count(scans)}' if scans.any() else '-'


def _latency(drive: ComparedDrive) -> str:
    p50, p99 = np.percentile(drive.replayed.latencies_s, [50, 99]) * 1e3
    return f'{p50:.0f} / {p99:.0f} ms'


def _map_rows(drives: list[ComparedDrive], sessions: Sequence[StoredSession]) -> _Rows:
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
