"""The figures of the paper (Tab. 1 and 2), which reports show next to what was measured.

The columns headed F-1/0.5/2 are in the order in which they are printed. In eleven of the thirteen rows the second is
below Recall@1, which the maximum of F_β over thresholds cannot be: accepting every answer gives F_β = Recall@1 for
every β. In every row they also exceed the harmonic-mean bound of such maxima. So no figure is compared with them.
"""

from __future__ import annotations

from typing import NamedTuple


class PaperRow(NamedTuple):
    """One method: Recall@N in %, the F columns as printed, average precision."""

    recall_at_1: float
    recall_at_5: float
    recall_at_10: float
    f_printed: tuple[float, float, float]
    average_precision: float


PAPER_TITLES = {1: 'Oxford Radar RobotCar (Tab. 1 of the paper)', 2: 'MulRan, Riverside (Tab. 2 of the paper)'}

PAPER_TABLES: dict[int, dict[str, PaperRow]] = {
    1: {
        'bc_radar': PaperRow(85.39, 88.59, 90.52, (0.89, 0.83, 0.75), 0.95),
        'vae': PaperRow(48.35, 62.88, 69.81, (0.56, 0.48, 0.56), 0.70),
        'ring_key': PaperRow(83.68, 86.49, 88.32, (0.85, 0.81, 0.71), 0.94),
        'stun': PaperRow(89.49, 92.23, 93.71, (0.92, 0.87, 0.76), 0.98),
        'mc_dropout': PaperRow(88.51, 91.57, 93.24, (0.91, 0.85, 0.76), 0.97),
        'ours': PaperRow(90.46, 93.76, 95.22, (0.93, 0.87, 0.77), 0.98),
        'ours (M)': PaperRow(93.67, 96.24, 97.39, (0.95, 0.91, 0.78), 0.99),
    },
    2: {
        'bc_radar': PaperRow(32.23, 37.81, 40.70, (0.36, 0.31, 0.36), 0.43),
        'vae': PaperRow(36.47, 46.54, 52.58, (0.41, 0.35, 0.42), 0.50),
        'ring_key': PaperRow(27.53, 29.34, 30.17, (0.30, 0.27, 0.30), 0.36),
        'mc_dropout': PaperRow(32.90, 37.50, 40.50, (0.35, 0.32, 0.34), 0.43),
        'stun': PaperRow(26.76, 31.15, 34.04, (0.31, 0.26, 0.31), 0.36),
        'ours': PaperRow(37.50, 43.54, 47.57, (0.44, 0.37, 0.43), 0.51),
    },
}
