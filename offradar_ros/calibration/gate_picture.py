"""Picture of the probability and of its gate. Needs matplotlib, which is imported when it is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from offradar_ros.calibration.error_control import Counts, interval
from offradar_ros.calibration.gate_choice import PROBABILITIES, GateChoice
from offradar_ros.calibration.picture_file import save_picture

BINS = 10


def draw_gate(choice: GateChoice, path: Path) -> None:
    """Reliability of the cross-fitted probability, and what each gate would do.

    The end of `path` names the format of the picture; ConfigError where it cannot be written.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(14.0, 4.2), layout='constrained', dpi=110)
    bins, answers, promises = figure.subplots(1, 3)
    _draw_bins(bins, choice)
    _draw_answers(answers, choice)
    _draw_promises(promises, choice)
    for axis in (answers, promises):
        axis.axvline(choice.row, color='k', linestyle='--', label=f'gate {choice.min_probability:g}')
        axis.set_xticks(range(len(PROBABILITIES)), [f'{value:g}' for value in PROBABILITIES], rotation=60)
        axis.set_xlabel('least probability that is answered')
    for axis in (bins, answers, promises):
        axis.grid(alpha=0.3)
        axis.legend(fontsize='x-small')
    queries = choice.fit.queries
    figure.suptitle(
        f'{queries.scans} scans of {queries.drives} drives, a half of each map left out; bars: confidence '
        f'{choice.limit.confidence:g}',
        fontsize='medium',
    )
    save_picture(figure, path)


def _draw_bins(axis: Any, choice: GateChoice) -> None:
    """Share of right answers in equal intervals of p, with the number of answers in each."""
    p_right, right = choice.fit.p_right, choice.fit.right
    bins = np.minimum((p_right * BINS).astype(np.int64), BINS - 1)
    for number in np.unique(bins).tolist():
        rows = bins == number
        total, count = int(rows.sum()), int(right[rows].sum())
        low, high = interval(count, total, choice.limit.confidence)
        mean, share = float(p_right[rows].mean()), count / total
        axis.errorbar(mean, share, [[share - low], [high - share]], fmt='o', capsize=3, color='tab:blue')
        below = mean > 0.5
        axis.annotate(
            str(total),
            (mean, low if below else high),
            (0, -11 if below else 4),
            textcoords='offset points',
            ha='center',
            fontsize='x-small',
        )
    axis.plot([0, 1], [0, 1], 'k:', label='as it should be')
    axis.set_xlim(-0.05, 1.05)
    axis.set_ylim(-0.1, 1.1)
    axis.set_xlabel('p_right, mean of each interval (beside: number of answers)')
    axis.set_ylabel('share of right answers')


def _draw_answers(axis: Any, choice: GateChoice) -> None:
    queries, mixed = choice.fit.queries, choice.fit.queries.mixed
    on_map, found = int(queries.on_map[mixed].sum()), int(choice.fit.right[mixed].sum())
    right = choice.answers.answered - choice.answers.wrong
    axis.plot(right / on_map, 'o-', markersize=3, color='tab:blue', label='answered rightly, of the scans on the map')
    axis.plot(1.0 - right / found, 'o-', markersize=3, color='tab:orange', label='rejected, of the right answers')
    axis.set_ylim(-0.02, 1.02)
    axis.set_ylabel('share')


def _draw_promises(axis: Any, choice: GateChoice) -> None:
    for counts, wanted, color, name in (
        (choice.answers, choice.limit.error_rate, 'tab:red', 'wrong, of the answers'),
        (choice.off_map, choice.limit.off_map_rate, 'tab:purple', 'answered, of the scans off the map'),
    ):
        _draw_share(axis, counts, choice.limit.confidence, color, name)
        axis.axhline(wanted, color=color, linestyle=':', label=f'at most {wanted:g}')
    axis.set_ylim(bottom=0.0)
    axis.set_ylabel('share')


def _draw_share(axis: Any, counts: Counts, confidence: float, color: str, name: str) -> None:
    some = np.flatnonzero(counts.answered)
    shares = counts.wrong[some] / counts.answered[some]
    pairs = zip(counts.wrong[some].tolist(), counts.answered[some].tolist(), strict=True)
    ends = np.array([interval(k, n, confidence) for k, n in pairs])
    axis.errorbar(some, shares, np.abs(ends.T - shares), fmt='o-', markersize=3, capsize=2, color=color, label=name)
