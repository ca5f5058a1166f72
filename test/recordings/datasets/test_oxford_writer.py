"""Folders in Oxford's layout, read back by the reader of that data set."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from offradar_ros.errors import DataError
from offradar_ros.geometry import utm_to_geodetic
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.ground_truth import COLUMNS, write_ground_truth
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.recordings.datasets.oxford_writer import encode_oxford_png, write_oxford
from offradar_ros.recordings.datasets.positions import read_oxford_gps, read_oxford_ins
from offradar_ros.recordings.datasets.registry import open_sequence


@pytest.fixture(scope='module')
def drive() -> SimulatedSequence:
    city = make_city(CityPlan(seed=2, blocks=(1, 1), route_m=200.0))
    return SimulatedSequence(city, SessionPlan(scans=5, degraded=0.4, start_ns=1_700_000_000_123_456_789))


@pytest.fixture(scope='module')
def folder(drive: SimulatedSequence, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_oxford(drive, tmp_path_factory.mktemp('written') / 'drive')


def test_scans_come_back_with_the_same_power(drive: SimulatedSequence, folder: Path) -> None:
    read = open_sequence(folder)
    assert (read.name, read.layout, read.warnings) == ('drive', 'oxford', ())
    np.testing.assert_array_equal(read.stamps_ns, drive.stamps_ns // 1000 * 1000)
    for index in range(5):
        made, scan = drive.scan(index), read.scan(index)
        np.testing.assert_array_equal(scan.power, made.power)
        turn = np.angle(np.exp(1j * (scan.azimuths_rad - made.azimuths_rad)))
        assert np.abs(turn).max() <= np.pi / 5600 + 1e-9
        assert made.azimuth_stamps_ns is not None
        np.testing.assert_array_equal(scan.azimuth_stamps_ns, made.azimuth_stamps_ns // 1000 * 1000)
        assert scan.range_resolution_m == made.range_resolution_m


def test_positions_come_back(drive: SimulatedSequence, folder: Path) -> None:
    true = drive.trajectory
    for read in (read_oxford_gps(folder / 'gps' / 'gps.csv'), read_oxford_ins(folder / 'gps' / 'ins.csv')):
        np.testing.assert_array_equal(read.stamps_ns, true.stamps_ns // 1000 * 1000)
        np.testing.assert_allclose(read.positions[:, :2], true.positions[:, :2], rtol=0, atol=1e-8)
        np.testing.assert_allclose(read.positions[:, 2], true.positions[:, 2], rtol=0, atol=1e-4)
    ins = read_oxford_ins(folder / 'gps' / 'ins.csv')
    np.testing.assert_allclose(np.exp(1j * ins.yaws_rad), np.exp(1j * true.yaws_rad), atol=1e-6)
    assert open_sequence(folder).trajectory is not None


def test_utm_columns_and_velocities_agree_with_the_positions(folder: Path) -> None:
    with (folder / 'gps' / 'ins.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert {row['utm_zone'] for row in rows} == {'30U'}
    utm = np.array([[float(row[name]) for name in ('easting', 'northing', 'altitude')] for row in rows])
    positions = np.array([[float(row[name]) for name in ('latitude', 'longitude', 'altitude')] for row in rows])
    np.testing.assert_allclose(utm_to_geodetic(utm, 32630), positions, rtol=0, atol=1e-8)
    speeds = [np.hypot(float(row['velocity_east']), float(row['velocity_north'])) for row in rows]
    assert np.mean(speeds) == pytest.approx(8.0, abs=1.2)


def test_the_ground_truth_has_a_row_a_scan(drive: SimulatedSequence, tmp_path: Path) -> None:
    write_ground_truth(drive, tmp_path / 'truth.csv')
    with (tmp_path / 'truth.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert [int(row['stamp_ns']) for row in rows] == drive.stamps_ns.tolist()
    poses = np.array([[float(row[name]) for name in COLUMNS[1:4]] for row in rows])
    np.testing.assert_allclose(poses, drive.poses, atol=1e-3)
    for row, fault in zip(rows, drive.degradations, strict=True):
        assert row['kind'] == (fault.kind.value if fault else '')
        assert float(row['severity']) == pytest.approx(fault.severity if fault else 0.0, abs=1e-4)
    with pytest.raises(DataError, match='cannot be written'):
        write_ground_truth(drive, tmp_path / 'none' / 'truth.csv')


def test_bytes_made_elsewhere_are_written_as_they_are(drive: SimulatedSequence, folder: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    encoded = [encode_oxford_png(drive.scan(index)) for index in range(5)]
    other = write_oxford(drive, tmp_path / 'drive', encoded=encoded, progress=lambda *done: seen.append(done))
    assert seen == [(k, 5) for k in range(1, 6)]
    for file in (f for f in folder.rglob('*') if f.is_file()):
        assert (other / file.relative_to(folder)).read_bytes() == file.read_bytes()


def test_without_row_stamps_or_positions_the_scans_are_written(street: Callable[..., Any], tmp_path: Path) -> None:
    bare = dataclasses.replace(street(count=2))
    write_oxford(bare, tmp_path / 'street')
    np.testing.assert_array_equal(open_sequence(tmp_path / 'street').stamps_ns, bare.stamps_ns)
    with pytest.raises(DataError, match='holds no scans'):
        write_oxford(street(count=0), tmp_path / 'none')
    assert not (tmp_path / 'none').exists()


def test_only_a_folder_of_this_layout_is_replaced_and_only_with_overwrite(
    drive: SimulatedSequence, tmp_path: Path
) -> None:
    write_oxford(drive, tmp_path / 'drive')
    with pytest.raises(DataError, match='exists already'):
        write_oxford(drive, tmp_path / 'drive')
    write_oxford(drive, tmp_path / 'drive', overwrite=True)
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'metadata.yaml').touch()
    with pytest.raises(DataError, match=r'not a folder with radar\.timestamps: not overwritten'):
        write_oxford(drive, tmp_path / 'bag', overwrite=True)
