"""A picture of the most and the least uncertain scans."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from offradar_ros.calibration.picture_file import save_picture
from offradar_ros.config import CartesianConfig
from offradar_ros.encoders.rings import ring_power
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.plots import new_figure
from offradar_ros.lab.evaluation.runner import Worlds, drives_of_pair
from offradar_ros.radar.cartesian import PolarToCartesian

SHOWN = 10
FURTHEST_M = 164.0
"""Range of the networks that ship."""

SIDE_PX = 256

_RINGS = 128


class _Extreme(NamedTuple):
    """A scan: row `row` of `drive`."""

    uncertainty: float
    drive: Drive
    row: int


def draw_extremes(several: Sequence[Answers], worlds: Worlds, path: Path) -> None:
    """Ten most uncertain scans (top) and ten least uncertain ones, each as an image above its ring key.

    A ring key is the mean power against range, in the recorded bytes. Titles give U, and the degradation of a simulated
    scan or the name of the recording. Scans that the encoder refuses are left out; if it refuses all, nothing is drawn.
    """
    scans = _sorted(several, worlds)
    if not scans:
        return
    picked = [scans[::-1][:SHOWN], scans[:SHOWN]]
    columns = max(len(row) for row in picked)
    figure = new_figure(2.0 * columns, 6.4)
    axes = figure.subplots(4, columns, squeeze=False, height_ratios=(2.0, 1.0, 2.0, 1.0))
    to_image = image_converter([extreme.drive.scan(extreme.row).max_range_m for row in picked for extreme in row])
    for number, row in enumerate(picked):
        for column, extreme in enumerate(row):
            _draw(axes[2 * number][column], axes[2 * number + 1][column], extreme, to_image)
    simulated = all(extreme.drive.layout == 'simulation' for extreme in scans)
    word = ', simulated' if simulated else ''
    figure.suptitle(
        f'Most (top) and least uncertain scans of {several[0].pair.method}{word}, with their ring keys',
        fontsize='medium',
    )
    save_picture(figure, path)


def image_converter(ranges_m: Sequence[float]) -> PolarToCartesian:
    """The conversion to images that show scans of these ranges, to 164 m at most."""
    reach_m = min(max(ranges_m), FURTHEST_M)
    return PolarToCartesian(CartesianConfig(side_px=SIDE_PX, resolution_m=2.0 * reach_m / SIDE_PX))


def _sorted(several: Sequence[Answers], worlds: Worlds) -> list[_Extreme]:
    found = []
    for answers in {(a.pair.group, a.pair.world, a.pair.query_index): a for a in several}.values():
        _, drive = drives_of_pair(answers.pair, worlds)
        usable = np.flatnonzero(np.isfinite(answers.uncertainties))
        found += [_Extreme(float(answers.uncertainties[row]), drive, row) for row in usable.tolist()]
    return sorted(found, key=lambda extreme: extreme.uncertainty)


def _draw(image_axis: Any, key_axis: Any, extreme: _Extreme, to_image: PolarToCartesian) -> None:
    uncertainty, drive, row = extreme
    scan = drive.scan(row)
    image_axis.imshow(to_image(scan), cmap='gray', vmin=0, vmax=160)
    image_axis.set_axis_off()
    kind, known_clean = str(drive.kinds[row]), drive.severities[row] == 0.0
    condition = f'{kind} {drive.severities[row]:.2f}' if kind else 'clean' if known_clean else drive.name
    image_axis.set_title(f'U {uncertainty:.4g}\n{condition}', fontsize='small')
    reach_m = min(scan.max_range_m, FURTHEST_M)
    key = ring_power(scan, _RINGS, reach_m, CartesianConfig().min_range_m).mean(axis=0)
    key_axis.plot((np.arange(_RINGS) + 0.5) * reach_m / _RINGS, key, linewidth=0.8)
    key_axis.set_ylim(0, 120)
    key_axis.set_xlabel('range (m)', fontsize='xx-small')
    key_axis.tick_params(labelsize='xx-small')
