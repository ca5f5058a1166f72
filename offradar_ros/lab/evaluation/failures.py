"""A picture of wrong answers: the query, the place found and the nearest place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.errors import RefusedInput
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.extremes import image_converter
from offradar_ros.lab.evaluation.plots import new_figure
from offradar_ros.lab.evaluation.runner import Worlds, drives_of_pair
from offradar_ros.radar.cartesian import PolarToCartesian

SHOWN = 6
APART_M = 50.0
"""Of wrong answers nearer to each other than this, one is shown."""


class _Failure(NamedTuple):
    uncertainty: float
    answers: Answers
    row: int


def draw_failures(several: Sequence[Answers], worlds: Worlds, path: Path) -> None:
    """The wrong answers of lowest U, one row each: query, place found, and the place nearest to the query.

    Images are in the frame of the sensor, so that a place seen from another direction is rotated. Nothing is drawn if
    no answer is wrong.
    """
    picked = _most_certain(several, worlds)
    if not picked:
        return
    figure = new_figure(7.2, 2.6 * len(picked) + 0.6)
    axes = figure.subplots(len(picked), 3, squeeze=False)
    to_image = image_converter([range_m for failure in picked for range_m in _ranges_m(failure, worlds)])
    for row, (uncertainty, answers, at) in zip(axes, picked, strict=True):
        mapped, query = drives_of_pair(answers.pair, worlds)
        nearest_m = float(np.hypot(*(mapped.poses[answers.nearest[at], :2] - query.poses[at, :2])))
        _show(row[0], query, at, f'{query.name} scan {at}\nU {uncertainty:.4g}', to_image)
        _show(row[1], mapped, int(answers.found[at]), f'found: {answers.errors_m[at]:.0f} m away', to_image)
        _show(row[2], mapped, int(answers.nearest[at]), f'nearest: {nearest_m:.0f} m away', to_image)
    method = several[0].pair.method
    figure.suptitle(
        f'Wrong answers of {method} with the lowest U: query, place found, nearest place', fontsize='medium'
    )
    save_picture(figure, path)


def _ranges_m(failure: _Failure, worlds: Worlds) -> Iterator[float]:
    """Ranges of the query and of the place found: one road may be driven with several radars."""
    mapped, query = drives_of_pair(failure.answers.pair, worlds)
    for drive, row in ((query, failure.row), (mapped, int(failure.answers.found[failure.row]))):
        yield drive.scan(row).max_range_m


def _most_certain(several: Sequence[Answers], worlds: Worlds) -> list[_Failure]:
    failures = [
        _Failure(float(answers.uncertainties[row]), answers, row)
        for answers in several
        for row in np.flatnonzero(answers.positive & ~answers.correct & np.isfinite(answers.distances)).tolist()
    ]
    picked: list[_Failure] = []
    for failure in sorted(failures, key=lambda f: f.uncertainty):
        if len(picked) < SHOWN and not any(_near_each_other(failure, other, worlds) for other in picked):
            picked.append(failure)
    return picked


def _near_each_other(one: _Failure, other: _Failure, worlds: Worlds) -> bool:
    """Whether two wrong answers are near each other on the same road."""
    if (one.answers.pair.group, one.answers.pair.world) != (other.answers.pair.group, other.answers.pair.world):
        return False
    places = [drives_of_pair(f.answers.pair, worlds)[1].poses[f.row, :2] for f in (one, other)]
    return bool(np.hypot(*(places[0] - places[1])) < APART_M)


def _show(axis: Any, drive: Drive, row: int, title: str, to_image: PolarToCartesian) -> None:
    axis.set_axis_off()
    axis.set_title(title, fontsize='x-small')
    if drive.kinds[row]:
        axis.set_title(f'{title}, {drive.kinds[row]} {drive.severities[row]:.2f}', fontsize='x-small')
    try:
        axis.imshow(to_image(drive.scan(row)), cmap='gray', vmin=0, vmax=160)
    except RefusedInput as refusal:
        axis.text(0.5, 0.5, f'cannot be drawn:\n{refusal.cause}', ha='center', va='center', fontsize='x-small')
