"""A picture of alignments: scans of queries laid over those of the places they were aligned with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.config import CartesianConfig
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.alignments import AlignedPair
from offradar_ros.lab.evaluation.plots import new_figure
from offradar_ros.lab.evaluation.runner import Worlds, drives_of_pair
from offradar_ros.radar.cartesian import PolarToCartesian
from offradar_ros.types import PolarScan

SHOWN, COLUMNS = 10, 5
REACH_M = 80.0
"""Range of a signature: farther returns are not aligned."""
PLACE, QUERY, TRUTH = '#ff30ff', '#30ff30', '#ffd000'
_CELL_M = 0.5
_ARROW_M = 14.0
_BRIGHTEST = 99.5
"""Percentile of the power that is shown as bright as can be."""


class _Overlay(NamedTuple):
    """An alignment: query and place are rows of their drives, poses (3,) are in the frame of the place's vehicle."""

    error_m: float
    error_deg: float
    score: float
    away_m: float
    mapped: Drive
    place: int
    drive: Drive
    query: int
    pose: NDArray[np.float64]
    truth: NDArray[np.float64]


def draw_overlays(several: Sequence[AlignedPair], worlds: Worlds, tolerance_m: float, path: Path) -> None:
    """Ten alignments at evenly spaced quantiles of the error of the position, the best and the worst one included.

    Of all pairs of a query and a place within the tolerance of it whose poses are known. Nothing is drawn if there is
    none.
    """
    found = sorted(_overlays(several, worlds, tolerance_m), key=lambda overlay: overlay.error_m)
    if not found:
        return
    at = np.unique(np.linspace(0, len(found) - 1, min(SHOWN, len(found))).round().astype(int)).tolist()
    columns = min(COLUMNS, len(at))
    lines = math.ceil(len(at) / columns)
    figure = new_figure(3.1 * max(columns, 3), 3.3 * lines + 0.8)
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True)
    to_image = PolarToCartesian(CartesianConfig(side_px=round(2.0 * REACH_M / _CELL_M), resolution_m=_CELL_M))
    for axis in axes.ravel()[len(at) :]:
        axis.set_axis_off()
    for axis, row in zip(axes.ravel(), at, strict=False):
        share = row / max(len(found) - 1, 1)
        _draw(axis, found[row], share, to_image)
    for axis in axes[-1]:
        axis.set_xlabel('to the right (m)', fontsize='x-small')
    for axis in axes[:, 0]:
        axis.set_ylabel('forward (m)', fontsize='x-small')
    _legend(figure)
    simulated = all(overlay.drive.layout == 'simulation' for overlay in found)
    word = 'simulated' if simulated else 'recorded'
    figure.suptitle(
        f'Alignments of {several[0].pair.method} with places within {tolerance_m:g} m, from the best to the worst of '
        f'{len(found)}, {word} scans',
        fontsize='medium',
    )
    save_picture(figure, path)


def _overlays(several: Sequence[AlignedPair], worlds: Worlds, tolerance_m: float) -> list[_Overlay]:
    found = []
    for pair, answers in ((one.pair, one.answers) for one in several):
        mapped, drive = drives_of_pair(pair, worlds)
        known = np.isfinite(answers.errors).all(axis=-1) & (answers.away_m <= tolerance_m)
        for number, place in np.argwhere(known).tolist():
            error, truth = answers.errors[number, place], answers.truths[number, place]
            found.append(
                _Overlay(
                    math.hypot(error[0], error[1]),
                    math.degrees(abs(error[2])),
                    float(answers.scores[number, place]),
                    float(answers.away_m[number, place]),
                    mapped,
                    int(answers.place_rows[number, place]),
                    drive,
                    int(answers.query_rows[number]),
                    truth + error,
                    truth,
                )
            )
    return found


def _draw(axis: Any, overlay: _Overlay, share: float, to_image: PolarToCartesian) -> None:
    place = brightness(overlay.mapped.scan(overlay.place), to_image)
    query = moved(brightness(overlay.drive.scan(overlay.query), to_image), overlay.pose)
    colours = np.clip(place[..., None] * _rgb(PLACE) + query[..., None] * _rgb(QUERY), 0.0, 1.0)
    axis.imshow(colours, extent=(-REACH_M, REACH_M, -REACH_M, REACH_M), interpolation='bilinear')
    for pose, colour, width in (
        (np.zeros(3), PLACE, 2.0),
        (overlay.truth, TRUTH, 4.5),
        (overlay.pose, QUERY, 2.0),
    ):
        _arrow(axis, pose, colour, width)
    axis.set_xlim(-REACH_M, REACH_M)
    axis.set_ylim(-REACH_M, REACH_M)
    axis.set_xticks((-50, 0, 50))
    axis.set_yticks((-50, 0, 50))
    axis.tick_params(labelsize='x-small')
    kinds = ' on '.join(
        str(drive.kinds[row]) or 'clean'
        for drive, row in ((overlay.drive, overlay.query), (overlay.mapped, overlay.place))
    )
    condition = '' if kinds == 'clean on clean' else f', {kinds}'
    axis.set_title(
        f'{share:.0%}: off by {overlay.error_m:.2f} m, {overlay.error_deg:.2f}°\n'
        f'score {overlay.score:.2f}, {overlay.away_m:.1f} m away{condition}',
        fontsize='small',
    )


def brightness(scan: PolarScan, to_image: PolarToCartesian) -> NDArray[np.float32]:
    """(S, S) float32 image of a scan, 0 for noise to 1."""
    image = to_image(scan).astype(np.float32)
    seen = image[image > 0.0]
    if not len(seen):
        return image
    noise, brightest = np.percentile(seen, (60.0, _BRIGHTEST))
    bright: NDArray[np.float32] = np.clip((image - noise) / max(brightest - noise, 1.0), 0.0, 1.0)
    return bright


def moved(image: NDArray[np.float32], pose: NDArray[np.float64]) -> NDArray[np.float32]:
    """The image of a scan at a pose in the frame of the place, x forward and y to the left, in that of the place.

    Convention of `PolarToCartesian`: x is up, y to the left.
    """
    middle, (x_m, y_m, yaw_rad) = len(image) / 2.0 - 0.5, pose.tolist()
    matrix = cv2.getRotationMatrix2D((middle, middle), math.degrees(yaw_rad), 1.0)
    matrix[:, 2] += (-y_m / _CELL_M, -x_m / _CELL_M)
    return np.asarray(cv2.warpAffine(image, matrix, image.shape[::-1]), np.float32)


def _arrow(axis: Any, pose: NDArray[np.float64], colour: str, width: float) -> None:
    x_m, y_m, yaw_rad = pose.tolist()
    tip = (-(y_m + _ARROW_M * math.sin(yaw_rad)), x_m + _ARROW_M * math.cos(yaw_rad))
    axis.annotate(
        '',
        xy=tip,
        xytext=(-y_m, x_m),
        arrowprops={'arrowstyle': '-|>', 'color': colour, 'linewidth': width, 'shrinkA': 0, 'shrinkB': 0},
    )
    axis.plot([-y_m], [x_m], 'o', color=colour, markersize=3.0 + width)


def _legend(figure: Any) -> None:
    from matplotlib.lines import Line2D  # noqa: PLC0415
    from matplotlib.patches import Patch  # noqa: PLC0415

    lines = [
        Patch(color=PLACE, label='scan of the place'),
        Patch(color=QUERY, label='query, as aligned'),
        Patch(facecolor='white', edgecolor='0.5', label='both'),
        *(
            Line2D([], [], color=colour, linewidth=width, marker='o', label=label)
            for colour, width, label in (
                (PLACE, 2.0, 'vehicle at the place'),
                (TRUTH, 4.5, 'vehicle in truth'),
                (QUERY, 2.0, 'vehicle as aligned'),
            )
        ),
    ]
    figure.legend(handles=lines, loc='outside lower center', ncols=len(lines), fontsize='small')


def _rgb(colour: str) -> NDArray[np.float64]:
    return np.array([int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5)])
