"""Pictures of wrong answers: the query, the place that it found and the place that it should have found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from offradar_ros.errors import RefusedInput
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.extremes import images_of
from offradar_ros.lab.evaluation.figures import new_figure
from offradar_ros.lab.evaluation.runner import Worlds, drives_of_pair
from offradar_ros.radar.cartesian import PolarToCartesian

SHOWN = 6
APART_M = 50.0
"""Of the failures near each other on the road one is shown."""


class _Failure(NamedTuple):
    uncertainty: float
    answers: Answers
    row: int


def draw_failures(several: Sequence[Answers], worlds: Worlds, path: Path) -> None:
    """The wrong answers that the encoder was surest of, a row each: query, found place, nearest right place.

    All as images to the radar's range, as they were scanned: a place seen from another direction is turned. Nothing is
    drawn where no answer is wrong.
    """
    picked = _surest(several, worlds)
    if not picked:
        return
    figure = new_figure(7.2, 2.6 * len(picked) + 0.6)
    axes = figure.subplots(len(picked), 3, squeeze=False)
    to_image = images_of([range_m for failure in picked for range_m in _ranges_m(failure, worlds)])
    for row, (uncertainty, answers, at) in zip(axes, picked, strict=True):
        mapped, query = drives_of_pair(answers.pair, worlds)
        right_m = float(np.hypot(*(mapped.poses[answers.right[at], :2] - query.poses[at, :2])))
        _show(row[0], query, at, f'{query.name} scan {at}\nU {uncertainty:.4g}', to_image)
        _show(row[1], mapped, int(answers.found[at]), f'found: {answers.errors_m[at]:.0f} m away', to_image)
        _show(row[2], mapped, int(answers.right[at]), f'right: {right_m:.0f} m away', to_image)
    method = several[0].pair.method
    figure.suptitle(f'Wrong answers that {method} was surest of: query, found, right', fontsize='medium')
    figure.savefig(path)


def _ranges_m(failure: _Failure, worlds: Worlds) -> Iterator[float]:
    """Of the query and of what it found: one road may be driven with several radars."""
    mapped, query = drives_of_pair(failure.answers.pair, worlds)
    for drive, row in ((query, failure.row), (mapped, int(failure.answers.found[failure.row]))):
        yield drive.scan(row).max_range_m


def _surest(several: Sequence[Answers], worlds: Worlds) -> list[_Failure]:
    failures = [
        _Failure(float(answers.uncertainties[row]), answers, row)
        for answers in several
        for row in np.flatnonzero(answers.positive & ~answers.correct & np.isfinite(answers.distances)).tolist()
    ]
    picked: list[_Failure] = []
    for failure in sorted(failures, key=lambda f: f.uncertainty):
        if len(picked) < SHOWN and not any(_of_one_place(failure, other, worlds) for other in picked):
            picked.append(failure)
    return picked


def _of_one_place(one: _Failure, other: _Failure, worlds: Worlds) -> bool:
    """Whether two failures are of one stretch of road."""
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
