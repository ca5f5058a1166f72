"""Pictures of simulated scans, alone and next to recorded ones."""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib as mpl

mpl.use('Agg')
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scan_statistics import LAGS_M, LAGS_ROWS, mean_against_range, statistics

from offradar_ros.config import CartesianConfig
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.degradation import Degradation, DegradationKind
from offradar_ros.lab.simulation.physics import NOMINAL_PHYSICS, RadarPhysics, draw_physics, held_out_physics
from offradar_ros.lab.simulation.radar_model import RadarModel
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.lab.simulation.traversal import Traversal
from offradar_ros.lab.simulation.weather import CLEAR, Weather
from offradar_ros.lab.simulation.world import World
from offradar_ros.radar.cartesian import PolarToCartesian
from offradar_ros.types import PolarScan

Image = NDArray[np.float32]
Pairs = list[tuple[str, list[PolarScan], dict[str, list[PolarScan]]]]
SENSOR = SimulatedSensor()
SEVERITIES = (0.2, 0.5, 1.0)


def draw_statistics(pairs: Pairs, path: Path) -> None:
    """Draw curves of each pair of sources: mean byte against range, quantiles, autocorrelations."""
    figure, rows = plt.subplots(len(pairs), 4, figsize=(15, 3.1 * len(pairs)), squeeze=False)
    for axes, (name, simulated, recorded) in zip(rows, pairs, strict=True):
        for source, scans in {name: simulated, **recorded}.items():
            style = {'color': 'black', 'linewidth': 2.2} if source == name else {'linewidth': 1.2}
            found = statistics(scans)
            shares = np.linspace(0.0, 1.0, 200)[:-1]
            power = np.concatenate([scan.power[:, round(3.0 / scan.range_resolution_m) :].ravel() for scan in scans])
            axes[0].plot(*mean_against_range(scans), label=source, **style)
            axes[1].plot(shares, np.quantile(power, shares), **style)
            axes[2].plot(LAGS_M, found.along_range, marker='.', **style)
            axes[3].plot(LAGS_ROWS, found.along_azimuth, marker='.', **style)
        _label(axes[0], 'range, m', 'mean byte')
        _label(axes[1], 'share of bytes', 'byte not exceeded')
        _label(axes[2], 'lag in range, m', 'autocorrelation')
        _label(axes[3], 'lag in azimuth, rows', 'autocorrelation')
        axes[0].legend(fontsize=8)
        for axis, lags in zip(axes[2:], (LAGS_M, LAGS_ROWS), strict=True):
            axis.set_xscale('log')
            axis.set_xticks(lags, [f'{lag:g}' for lag in lags])
            axis.minorticks_off()
    _save(figure, path)


def draw_side_by_side(pairs: Pairs, path: Path) -> None:
    """Draw recorded scans next to simulated ones of the same kind, from above and as polar images."""
    shown = [(name, simulated, source, scans) for name, simulated, of in pairs for source, scans in of.items()]
    figure, rows = plt.subplots(len(shown), 4, figsize=(16, 4.2 * len(shown)), squeeze=False)
    for k, (axes, (name, simulated, source, scans)) in enumerate(zip(rows, shown, strict=True)):
        brightest = 2.2 * np.quantile(scans[0].power, 0.98)
        for axis, (title, scan) in zip(
            axes.reshape(2, 2), ((name, simulated[(5 * k) % len(simulated)]), (source, scans[0])), strict=True
        ):
            _show(axis[0], from_above(scan), title, brightest)
            _show(axis[1], polar(scan), 'azimuth down, 100 m across', brightest)
    _save(figure, path)


def draw_simulated(path: Path) -> None:
    """Draw one place: clean, by other radars, in weather, and with each fault at three severities."""
    world = make_city(CityPlan(seed=1))
    panels: list[list[tuple[str, Image]]] = []
    clean = _scan_of(world)
    panels.append(
        [
            ('clean', from_above(clean)),
            ('clean, azimuth down, 100 m across', polar(clean)),
            ('a radar drawn for training', from_above(_scan_of(world, physics=draw_physics(5)))),
            ('a radar held out of training', from_above(_scan_of(world, physics=held_out_physics(1)))),
        ]
    )
    panels.append(
        [
            (title, from_above(_scan_of(world, weather=weather)))
            for title, weather in (
                ('rain, 10 mm/h', Weather(rain_mm_h=10.0)),
                ('rain, 100 mm/h', Weather(rain_mm_h=100.0)),
                ('snow, 5 mm/h', Weather(snow_mm_h=5.0)),
                ('fog, 50 m', Weather(fog_visibility_m=50.0)),
            )
        ]
    )
    for kind in DegradationKind:
        scans = [_scan_of(world, fault=Degradation(kind, severity, 60)) for severity in SEVERITIES]
        titles = [f'{kind.value}, severity {severity}' for severity in SEVERITIES]
        row = [(title, from_above(scan)) for title, scan in zip(titles, scans, strict=True)]
        panels.append([*row, (titles[-1], polar(scans[-1]))])
    figure, rows = plt.subplots(len(panels), 4, figsize=(11, 2.9 * len(panels)))
    for axes, row in zip(rows, panels, strict=True):
        for axis, (title, image) in zip(axes, row, strict=True):
            _show(axis, image, title, 110.0)
    figure.set_dpi(70)
    figure.tight_layout()
    figure.canvas.draw()
    gray = cv2.cvtColor(np.asarray(figure.canvas.buffer_rgba()), cv2.COLOR_RGBA2GRAY)  # type: ignore[attr-defined]
    # 32 shades of grey: a third of the size, without a visible difference.
    cv2.imwrite(str(path), np.asarray(gray, np.uint8) & 0xF8, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    plt.close(figure)
    print(f'{path}: written')


def from_above(scan: PolarScan) -> Image:
    """The image of learned encoders: 128 m across, forward up."""
    return PolarToCartesian(CartesianConfig())(scan).astype(np.float32)


def polar(scan: PolarScan) -> Image:
    """The nearest 100 m, 400 × 400."""
    near = scan.power[:, : round(100.0 / scan.range_resolution_m)].astype(np.float32)
    return np.asarray(cv2.resize(near, (400, 400), interpolation=cv2.INTER_AREA), np.float32)


def _scan_of(
    world: World, physics: RadarPhysics = NOMINAL_PHYSICS, weather: Weather = CLEAR, fault: Degradation | None = None
) -> PolarScan:
    drive = Traversal(SessionPlan(seed=1), world, 60.0)
    model = RadarModel(SENSOR, physics, weather)
    poses = drive.poses_at(20.0 + SENSOR.rotation_s * np.arange(SENSOR.azimuths) / SENSOR.azimuths)
    seen = drive.reflectors_at(20.0, SENSOR.max_range_m)
    power = model.render(seen, poses, np.random.default_rng(0), fault)
    return PolarScan(0, power, model.azimuths_rad, SENSOR.range_resolution_m)


def _label(axis: Axes, x: str, y: str) -> None:
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.grid(alpha=0.3)


def _show(axis: Axes, image: Image, title: str, brightest: float) -> None:
    axis.imshow(image, cmap='gray', vmin=0.0, vmax=brightest)
    axis.set_title(title, fontsize=9)
    axis.axis('off')


def _save(figure: Figure, path: Path) -> None:
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=80)
    plt.close(figure)
    print(f'{path}: written')
