"""Reliability plot: the share of wrong answers against U. Needs matplotlib, which is imported when it is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from offradar_ros.calibration.error_control import interval
from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.calibration.threshold_choice import ThresholdChoice

BINS = 10


def draw_reliability(choice: ThresholdChoice, path: Path) -> None:
    """Share of wrong answers in bins of U of equally many scans, and what each static threshold would do.

    The end of `path` names the format of the picture; ConfigError where it cannot be written.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(10.0, 4.2), layout='constrained', dpi=110)
    bins, curves = figure.subplots(1, 2)
    _draw_bins(bins, choice)
    _draw_curves(curves, choice)
    for axis in (bins, curves):
        axis.axvline(choice.threshold, color='k', linestyle='--', label=f'threshold {choice.threshold:.3f}')
        axis.set_ylim(-0.02, 1.02)
        axis.grid(alpha=0.3)
        axis.legend(fontsize='x-small')
    figure.suptitle(
        f'{len(choice.queries)} scans of {choice.queries.drives} drives; bars: confidence {choice.confidence:g}',
        fontsize='medium',
    )
    save_picture(figure, path)


def _draw_bins(axis: Any, choice: ThresholdChoice) -> None:
    known = np.flatnonzero(np.isfinite(choice.queries.uncertainties))
    order = known[np.argsort(choice.queries.uncertainties[known], kind='stable')]
    parts = [part for part in np.array_split(order, BINS) if len(part)]
    wrong = [int(choice.queries.wrong[part].sum()) for part in parts]
    shares = np.array([k / len(part) for k, part in zip(wrong, parts, strict=True)])
    ends = np.array([interval(k, len(part), choice.confidence) for k, part in zip(wrong, parts, strict=True)])
    medians = [float(np.median(choice.queries.uncertainties[part])) for part in parts]
    axis.errorbar(medians, shares, np.abs(ends.T - shares), fmt='o', capsize=3, color='tab:red')
    axis.set_xlabel(f'U, median of each of {len(parts)} bins of equally many scans')
    axis.set_ylabel('share of wrong answers')


def _draw_curves(axis: Any, choice: ThresholdChoice) -> None:
    answered, wrong = choice.counts
    some = answered > 0
    shares = wrong[some] / answered[some]
    ends = np.array(
        [interval(int(k), int(n), choice.confidence) for k, n in zip(wrong[some], answered[some], strict=True)]
    )
    thresholds = choice.thresholds
    axis.plot(thresholds[some], 1.0 - shares, 'o-', markersize=3, color='tab:blue', label='right, of the answers')
    band = f'its interval, confidence {choice.confidence:g}'
    axis.fill_between(thresholds[some], 1.0 - ends[:, 1], 1.0 - ends[:, 0], color='tab:blue', alpha=0.2, label=band)
    rejected = 1.0 - answered / len(choice.queries)
    axis.plot(thresholds, rejected, 'o-', markersize=3, color='tab:orange', label='rejected, of all scans')
    wanted = 1.0 - choice.error_rate
    axis.axhline(wanted, color='tab:blue', linestyle=':', label=f'right answers wanted: {wanted:g}')
    # Lower thresholds answer nothing.
    axis.set_xlim(float(thresholds[max(0, int(np.argmax(some)) - 1)]) - 0.02, float(thresholds[-1]) + 0.02)
    axis.set_xlabel('static threshold on U')
    axis.set_ylabel('share')
