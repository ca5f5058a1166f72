"""Sequences of one data set compared with each other, and with a split."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from offradar_ros.geometry import GeoPoint, LocalFrame, geodetic_to_utm, utm_to_geodetic
from offradar_ros.recordings.datasets.check.alignment import check_alignment
from offradar_ros.recordings.datasets.check.findings import Finding
from offradar_ros.recordings.datasets.check.route import nearest, route, share_near
from offradar_ros.recordings.datasets.check.scan_positions import ScanPositions, no_positions
from offradar_ros.recordings.datasets.check.split import check_split
from offradar_ros.recordings.datasets.positions import read_radar_utm
from offradar_ros.recordings.datasets.region import Circle, Region
from offradar_ros.recordings.datasets.splits import Split

OXFORD = GeoPoint(51.76, -1.26, 65.0)


def loop_m(seed: int, scans: int = 400) -> NDArray[np.float64]:
    """(N, 3) a closed route of about two kilometres; the seed chooses the lane alone."""
    angles = np.linspace(0.0, 2 * np.pi, scans, endpoint=False)
    radii = 300.0 + 80.0 * np.sin(2 * angles) + 40.0 * np.cos(5 * angles) + np.random.default_rng(seed).uniform(-2, 2)
    return np.stack([radii * np.cos(angles), 0.7 * radii * np.sin(angles), np.zeros(scans)], axis=1)


def drive(name: str, points_m: NDArray[np.float64]) -> ScanPositions:
    return ScanPositions(name, LocalFrame(OXFORD).to_geodetic(points_m), geodetic=True)


def moved(points_m: NDArray[np.float64], *by_m: float) -> NDArray[np.float64]:
    offset_m: NDArray[np.float64] = np.array(by_m)
    return points_m + offset_m


def found(*sequences: ScanPositions) -> list[Finding]:
    return list(check_alignment(sequences))


def problem_of(*sequences: ScanPositions) -> str:
    (problem,) = [finding.text for finding in found(*sequences) if finding.level == 'problem']
    return problem


def test_drives_of_one_route_align() -> None:
    findings = found(drive('a', loop_m(1)), drive('b', loop_m(2)), drive('c', loop_m(3)[::-1]))
    assert [finding.level for finding in findings] == ['ok'] * 3
    assert findings[0].text.startswith('a: 100% of its scans are within 25 m of ')


def test_the_nearest_point_is_the_nearest_of_all_pairs() -> None:
    rng = np.random.default_rng(5)
    points, line = rng.uniform(0.0, 400.0, (1200, 3)), rng.uniform(0.0, 400.0, (70, 3))
    away_m = np.linalg.norm(points[:, None] - line[None], axis=-1)
    np.testing.assert_allclose(nearest(points, line)[0], away_m.min(axis=1))
    np.testing.assert_array_equal(nearest(points, line)[1], away_m.argmin(axis=1))
    assert share_near(points, line, 40.0) == (away_m.min(axis=1) <= 40.0).mean()


def test_a_route_is_subsampled_by_distance_not_by_time() -> None:
    waiting = np.repeat([[0.0, 0.0, 0.0]], 5000, axis=0)
    moving = np.arange(0.0, 1000.0)[:, None] * (1.3, 0.0, 0.0)
    frame = LocalFrame(GeoPoint(OXFORD.latitude_deg, OXFORD.longitude_deg))
    made = route(frame.to_geodetic(np.concatenate([waiting, moving])), frame)
    assert len(made.scans) == 1000
    # Every fourth scan of those that move: 5.2 m.
    assert len(made.line) == 250


@pytest.mark.parametrize(('east_m', 'north_m'), [(60.0, 0.0), (-400.0, 733.0), (5000.0, -20_000.0)])
def test_a_constant_offset_is_reported(east_m: float, north_m: float) -> None:
    away = drive('moved', moved(loop_m(2), east_m, north_m, 0.0))
    text = problem_of(drive('a', loop_m(1)), drive('b', loop_m(3)), away)
    assert text.startswith('moved: ')
    words = text.rpartition('it fits ')[2].split()
    assert ' '.join(words[1:5]) == 'moved by a constant'
    # Over 20 km the curvature of the ground shows.
    assert float(words[5]) == pytest.approx(-east_m, abs=20.0)
    assert float(words[11]) == pytest.approx(-north_m, abs=20.0)


def test_an_offset_of_a_drive_along_part_of_the_route_is_reported() -> None:
    part = drive('part', moved(loop_m(2)[50:300], 900.0, 300.0, 0.0))
    assert 'moved by a constant -90' in problem_of(drive('a', loop_m(1)), part)


def test_two_sequences_that_do_not_meet_are_reported_once() -> None:
    findings = found(drive('a', loop_m(1)), drive('b', moved(loop_m(2), 2000.0, 0.0, 0.0)))
    assert [finding.level for finding in findings] == ['problem', 'note']
    assert 'never within 25 m of another sequence, the nearest is b, ' in findings[0].text


def test_exchanged_coordinates_and_a_wrong_sign_are_reported() -> None:
    right, other = drive('right', loop_m(1)), drive('wrong', loop_m(2))
    swapped = other._replace(positions=other.positions[:, [1, 0, 2]])
    assert problem_of(drive('b', loop_m(3)), right, swapped).endswith(' with latitude and longitude exchanged')
    mirrored = other._replace(positions=other.positions * (1.0, -1.0, 1.0))
    assert 'with the sign of the longitude changed' in problem_of(right, mirrored)


@pytest.mark.parametrize(('read_as', 'side'), [(32631, 'west'), (32629, 'east')])
def test_a_wrong_zone_is_reported(read_as: int, side: str) -> None:
    right, other = drive('right', loop_m(1)), drive('wrong', loop_m(2))
    wrong = other._replace(positions=utm_to_geodetic(geodetic_to_utm(other.positions, 32630), read_as))
    text = problem_of(right, drive('also', loop_m(3)), wrong)
    assert text.startswith('wrong: never within 25 m')
    assert text.endswith(f'in the next UTM zone to the {side}')
    assert ' km away; it fits ' in text


def test_another_place_is_no_problem() -> None:
    street = np.stack([np.linspace(0.0, 800.0, 300), np.full(300, 3000.0), np.zeros(300)], axis=1)
    findings = found(drive('a', loop_m(1)), drive('b', loop_m(2)), drive('street', street))
    assert [finding.level for finding in findings] == ['ok', 'ok', 'note']
    assert findings[2].text.endswith('of another place, or its positions are of another frame')


def test_a_shared_part_of_the_route_is_no_problem() -> None:
    ring = loop_m(1)
    leaves = np.concatenate([ring[:100], ring[100] + np.linspace([0, 0, 0], [0, 2500, 0], 300)])
    (_, second) = found(drive('a', ring), drive('leaves', leaves))
    assert second.level == 'note'
    assert second.text.startswith('leaves: ')
    assert 20 < int(second.text.split()[1].rstrip('%')) < 40


def test_frames_that_cannot_be_compared() -> None:
    metric = ScanPositions('metric', loop_m(1), geodetic=False)
    assert 'expected one kind' in problem_of(drive('a', loop_m(1)), metric)
    (note,) = found(metric, metric._replace(name='other'))
    assert (note.level, note.text) == (
        'note',
        'positions in metres, each sequence in its own frame, so not compared: metric, other',
    )
    (note,) = found(drive('a', loop_m(1)), no_positions('lost', 7))
    assert note.text == 'no scan has a position, so not compared: lost'


def test_the_recorded_drives_of_kaist_align(real_data: Path) -> None:
    drives = [
        ScanPositions(
            name, read_radar_utm(real_data / 'mulran_kaist03' / f'mulran_{name}_radar_utm.csv').positions, True
        )
        for name in ('KAIST01', 'KAIST02', 'KAIST03')
    ]
    assert {finding.level for finding in found(*drives)} == {'ok'}
    away = utm_to_geodetic(moved(geodetic_to_utm(drives[1].positions, 32652), 150.0, -80.0, 0.0), 32652)
    text = problem_of(drives[0], drives[1]._replace(positions=away), drives[2])
    assert text.startswith('KAIST02: ')
    assert 'moved by a constant -1' in text


def split(region: Region) -> Split:
    return Split('mine', 'Mine', 'this test', ('friday', 'saturday'), ('monday',), region)


def test_present_and_missing_sequences_of_a_split_are_reported() -> None:
    monday, friday = drive('monday', loop_m(1)), drive('friday', loop_m(2))
    friday.positions[:10] = np.nan
    findings = list(check_split(split(Region()), [monday, friday, no_positions('sunday', 3)]))
    assert [(finding.level, finding.text) for finding in findings] == [
        ('problem', '1 of 2 test sequences are missing: saturday'),
        ('ok', 'all 1 training sequences are there'),
        ('note', 'not of the split: sunday'),
        ('ok', 'friday: 390 of 400 scans tested (10 without a position)'),
        ('ok', 'monday: 400 of 400 scans usable for training'),
    ]


def test_scans_outside_a_region_are_counted() -> None:
    centre = geodetic_to_utm(LocalFrame(OXFORD).to_geodetic(np.array([[300.0, 0.0, 0.0]])), 32630)[0]
    region = Region(32630, (Circle(float(centre[1]), float(centre[0]), 100.0),))
    monday, friday = loop_m(1), loop_m(2)
    away_m = [np.hypot(*(points[:, :2] - (300.0, 0.0)).T) for points in (monday, friday)]
    usable, tested = int((away_m[0] > 150.0).sum()), int((away_m[1] <= 100.0).sum())
    findings = list(check_split(split(region), [drive('monday', monday), drive('friday', friday)]))
    reported = [finding.text for finding in findings][-2:]
    assert reported == [
        f'friday: {tested} of 400 scans tested ({400 - tested} outside the region)',
        f'monday: {usable} of 400 scans usable for training ({400 - usable} within 50 m of the test region)',
    ]
    assert 0 < tested < usable < 400
    metric = ScanPositions('monday', monday, geodetic=False)
    assert 'expected latitudes and longitudes' in list(check_split(split(region), [metric]))[-1].text


def test_a_sequence_without_usable_scans_is_a_problem() -> None:
    findings = list(check_split(split(Region()), [no_positions('monday', 4)]))
    assert findings[-1] == Finding('problem', 'monday: 0 of 4 scans usable for training (4 without a position)')
