"""Recorded scans aligned with one another, against odometry where there is any: see docs/alignment.md."""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from recorded_answers import print_head, print_row
from recorded_scans import BAY_BINS, bay_motions, bay_sessions, car_park, car_park_motions, evenly_spaced, positions
from scan_sources import read_arguments, recorded_sources
from scipy.stats import chi2

from offradar_ros.alignment.align import PreparedPlace, PreparedQuery, align, prepare_place, prepare_query
from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.twist import STANDING, Twist
from offradar_ros.lab.evaluation.metrics.auroc import auroc
from offradar_ros.recordings.source import open_source
from offradar_ros.types import Alignment, PolarScan

Pose = NDArray[np.float64]
"""(3,) float64 of x and y in metres and yaw in radians (REP 103)."""

ODOMETRY = 'oxford_tiny/gt/radar_odometry.csv'
OXFORD_STEPS, FOG_STEPS = (1, 2, 3), (1, 2, 3, 5, 8)
WAY_THERE, WAY_BACK = slice(0, 12), slice(33, 42)
BAY_BIN_M = 1.0
"""The size of a bin is not recorded: positions of the bay are in bins."""
FAULTS_SEED = 16


class Prepared(NamedTuple):
    """A scan, ready as either of a pair."""

    place: PreparedPlace
    query: PreparedQuery


def prepared(scans: Sequence[PolarScan], twists: Sequence[Twist] | None = None) -> list[Prepared]:
    """Scans, ready to be aligned with one another; `twists` are the velocities of the vehicle at their stamps."""
    make = SignatureMaker()
    found = []
    for scan, twist in zip(scans, twists or [STANDING] * len(scans), strict=True):
        signature = make(scan)
        found.append(Prepared(prepare_place(signature, twist), prepare_query(signature, twist)))
    return found


def then(first: Pose, second: Pose) -> Pose:
    """The pose `first`, and from there `second`."""
    cos, sin = math.cos(first[2]), math.sin(first[2])
    x_m, y_m = first[0] + cos * second[0] - sin * second[1], first[1] + sin * second[0] + cos * second[1]
    return np.array([x_m, y_m, math.remainder(first[2] + second[2], 2.0 * math.pi)])


def inverse(pose: Pose) -> Pose:
    """The frame that `pose` is seen from, seen from that pose."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.array([-cos * pose[0] - sin * pose[1], sin * pose[0] - cos * pose[1], -pose[2]])


def chain(steps: Sequence[Pose]) -> Pose:
    """One step after another."""
    whole = np.zeros(3)
    for step in steps:
        whole = then(whole, step)
    return whole


def apart(found: Pose, expected: Pose) -> tuple[float, float]:
    """Metres and degrees between two poses in one frame."""
    turned_deg = math.degrees(math.remainder(found[2] - expected[2], 2.0 * math.pi))
    return float(np.hypot(*(found - expected)[:2])), abs(turned_deg)


class Drive(NamedTuple):
    """Consecutive scans, and the motion from each to the next by odometry."""

    scans: list[PolarScan]
    steps: list[Pose]

    def twists(self) -> list[Twist]:
        """Velocity at each scan, from the steps before and after it, without slip to the side."""
        stamps_s = np.array([scan.stamp_ns for scan in self.scans]) / 1e9
        rates = np.array(self.steps) / np.diff(stamps_s)[:, None]
        middles = np.concatenate([rates[:1], (rates[:-1] + rates[1:]) / 2.0, rates[-1:]])
        return [Twist(float(forward), 0.0, float(yaw)) for forward, _, yaw in middles]


def oxford(real: Path) -> Drive:
    """The consecutive Oxford scans.

    Each row of their odometry is the pose of the source scan in the frame of the destination, the scan before it, with
    y to the right and yaw clockwise, as Oxford has it.
    """
    sequence = open_source(real / 'oxford_tiny')
    scans = [sequence.scan(index) for index in range(len(sequence))]
    with (real / ODOMETRY).open(encoding='utf-8', newline='') as file:
        rows = {int(row['source_radar_timestamp']): row for row in csv.DictReader(file)}
    steps = []
    for before, scan in itertools.pairwise(scans):
        row = rows[scan.stamp_ns // 1000]
        if int(row['destination_radar_timestamp']) != before.stamp_ns // 1000:
            raise ValueError(f'{ODOMETRY}: expected the step from {before.stamp_ns} to {scan.stamp_ns}')
        steps.append(np.array([float(row['x']), -float(row['y']), -float(row['yaw'])]))
    return Drive(scans, steps)


class Errors(NamedTuple):
    """Alignments against what they should be; (N,) float64 each.

    Attributes:
        metres: how far off the position is.
        degrees: how far off the yaw is.
        scores: of the alignments.
        squares: of the errors by the covariances, chi-squared of three degrees of freedom if these are right.
    """

    metres: NDArray[np.float64]
    degrees: NDArray[np.float64]
    scores: NDArray[np.float64]
    squares: NDArray[np.float64]

    @classmethod
    def of(cls, found: Sequence[Alignment], expected: Sequence[Pose]) -> Errors:
        """Of each alignment."""
        rows = []
        for one, pose in zip(found, expected, strict=True):
            off = one.pose - pose
            off[2] = math.remainder(off[2], 2.0 * math.pi)
            rows.append((*apart(one.pose, pose), one.score, float(off @ np.linalg.solve(one.covariance, off))))
        return cls(*np.array(rows).T)

    def cells(self) -> list[str]:
        """For a row of a table."""
        held = float((self.squares <= chi2.ppf(0.95, 3)).mean())
        return [
            str(len(self.metres)),
            *(f'{value:.2f} m' for value in np.quantile(self.metres, (0.5, 0.9, 1.0))),
            *(f'{value:.2f}°' for value in np.quantile(self.degrees, (0.5, 0.9, 1.0))),
            f'{self.scores.min():.2f}',
            f'{held:.0%}',
        ]


def steps_apart(scans: Sequence[Prepared], steps: int) -> list[Alignment]:
    """Each scan aligned with the one that many before it."""
    return [align(before.place, scan.query) for before, scan in zip(scans[:-steps], scans[steps:], strict=True)]


def oxford_errors(drive: Drive, scans: Sequence[Prepared], steps: int) -> Errors:
    """Pairs of Oxford scans that many apart, against their odometry."""
    found = steps_apart(scans, steps)
    return Errors.of(found, [chain(drive.steps[start : start + steps]) for start in range(len(found))])


def whole_drive(drive: Drive, scans: Sequence[Prepared]) -> tuple[float, float]:
    """Metres and degrees from the end of the odometry, after the alignments of one scan after another."""
    return apart(chain([one.pose for one in steps_apart(scans, 1)]), chain(drive.steps))


def there_and_back(scans: Sequence[Prepared], steps: int) -> Errors:
    """Each pair aligned both ways: the way back against the inverse of the way there."""
    back = [align(scan.place, before.query) for before, scan in zip(scans[:-steps], scans[steps:], strict=True)]
    return Errors.of(back, [inverse(one.pose) for one in steps_apart(scans, steps)])


def loops(scans: Sequence[Prepared], steps: int) -> Errors:
    """Pairs that many steps apart against the chain of single steps."""
    found, single = steps_apart(scans, steps), [one.pose for one in steps_apart(scans, 1)]
    return Errors.of(found, [chain(single[start : start + steps]) for start in range(len(found))])


def bay_errors(real: Path) -> dict[int, Errors]:
    """Sessions 1 and 2 of the bay against the middle scan of session 1, by the correlation of whole scans.

    That correlation knows turns to 1.4° and shifts to a bin.
    """
    sessions = {number: power for number, power in bay_sessions(real).items() if number != 3}
    motions = bay_motions(sessions | {3: sessions[2][:1]})
    scans = {number: prepared(evenly_spaced(power[:, :, :BAY_BINS], BAY_BIN_M)) for number, power in sessions.items()}
    reference = scans[1][len(scans[1]) // 2].place
    return {
        number: Errors.of(
            [align(reference, scan.query) for scan in scans[number]],
            [np.array([m.forward_m, -m.right_m, -m.turn_rad]) for m in motions[number]],
        )
        for number in scans
    }


class WayBack(NamedTuple):
    """The way back through the car park, each scan at the nearest of the way there, by the correlation of scans.

    Attributes:
        headings_deg: (N,) float64, clockwise as in its notes, 0 to 360.
        expected_deg: (N,) float64, the same by correlation.
        away_m: (N,) float64.
        scores: (N,) float64.
    """

    headings_deg: NDArray[np.float64]
    expected_deg: NDArray[np.float64]
    away_m: NDArray[np.float64]
    scores: NDArray[np.float64]


def way_back(real: Path) -> WayBack:
    """Headings on the way back through the car park."""
    scans = car_park(real)
    motions = car_park_motions(scans)
    at_m, turns_rad = positions(motions), np.array([motion.turn_rad for motion in motions])
    ready = prepared(scans)
    between_m = np.hypot(*(at_m[WAY_BACK][:, None] - at_m[WAY_THERE][None]).transpose(2, 0, 1))
    nearest = between_m.argmin(axis=1)
    pairs = list(zip(nearest.tolist(), range(WAY_BACK.start, WAY_BACK.stop), strict=True))
    found = [align(ready[place].place, ready[query].query) for place, query in pairs]
    return WayBack(
        np.degrees([-one.pose[2] for one in found]) % 360.0,
        np.degrees([turns_rad[query] - turns_rad[place] for place, query in pairs]) % 360.0,
        between_m.min(axis=1),
        np.array([one.score for one in found]),
    )


def foreign_scores(real: Path, most: int = 3) -> NDArray[np.float64]:
    """(N,) scores of scans of one recording with those of each other one, up to `most` scans of each."""
    ready = {name: prepared(scans) for name, scans in recorded_sources(real, most)}
    # It may be of the same streets as KAIST03.
    drives = {name: scans for name, scans in ready.items() if name != 'mulran_ray'}
    pairs = itertools.permutations(drives.values(), 2)
    return np.array([align(one.place, other.query).score for a, b in pairs for one in a for other in b])


def damaged(scan: PolarScan, seed: int) -> dict[str, PolarScan]:
    """The scan with a third of its turn blocked, half of it missing, and under noise, by what was done to it."""
    rng, rows = np.random.default_rng(seed), len(scan.power)
    order = np.roll(np.arange(rows), int(rng.integers(rows)))
    blocked, missing, noisy = (scan.power.copy() for _ in range(3))
    blocked[order[: rows // 3]] = rng.normal(8.0, 3.0, blocked[order[: rows // 3]].shape).clip(0.0, 255.0)
    missing[order[: rows // 2]] = 0
    noise = rng.exponential(30.0, noisy.shape).clip(0.0, 255.0).astype(np.uint8)
    return {
        'a third blocked': _with(scan, blocked),
        'half missing': _with(scan, missing),
        'noise of mean 30': _with(scan, np.maximum(noisy, noise)),
    }


def _with(scan: PolarScan, power: NDArray[np.uint8]) -> PolarScan:
    return PolarScan(
        scan.stamp_ns,
        power,
        scan.azimuths_rad,
        scan.range_resolution_m,
        scan.range_offset_m,
        scan.azimuth_stamps_ns,
    )


def damaged_errors(drive: Drive) -> dict[str, Errors]:
    """Damaged Oxford scans at the scan before each, sound, against the odometry."""
    ready = prepared(drive.scans[:-1])
    of_scans = [damaged(scan, FAULTS_SEED + number) for number, scan in enumerate(drive.scans[1:])]
    found = {}
    for fault in of_scans[0]:
        queries = prepared([faults[fault] for faults in of_scans])
        aligned = [align(before.place, query.query) for before, query in zip(ready, queries, strict=True)]
        found[fault] = Errors.of(aligned, drive.steps)
    return found


TITLES = ('pairs', 'median', '90 %', 'most', 'median', '90 %', 'most', 'least score', 'in the 95 % ellipsoid')


def main() -> None:
    """Print the tables."""
    real: Path = read_arguments(__doc__ or '').real
    drive = oxford(real)
    still, moving = prepared(drive.scans), prepared(drive.scans, drive.twists())
    print_head('Oxford, scans apart', *TITLES)
    for name, scans in (('as scanned', still), ('motion taken out', moving)):
        for steps in OXFORD_STEPS:
            print_row(f'{steps}, {name}', *oxford_errors(drive, scans, steps).cells())
    metres, degrees = whole_drive(drive, still)
    length_m = sum(float(np.hypot(*step[:2])) for step in drive.steps)
    for fault, errors in damaged_errors(drive).items():
        print_row(f'1, {fault}', *errors.cells())
    print(f'\n{len(drive.steps)} steps, {length_m:.1f} m, chained: {metres:.2f} m and {degrees:.2f}° off')
    sequences = {name: open_source(real / name) for name in ('mulran_kaist03', 'radiate_tiny_foggy')}
    kaist, fog = (prepared([seq.scan(row) for row in range(len(seq))]) for seq in sequences.values())
    rest = [align(a.place, b.query) for a, b in itertools.permutations(kaist, 2)]
    print_head('others', *TITLES)
    print_row('KAIST03, at rest', *Errors.of(rest, [np.zeros(3)] * len(rest)).cells())
    for steps in FOG_STEPS:
        print_row(f'RADIATE in fog, {steps} apart, there and back', *there_and_back(fog, steps).cells())
    for steps in FOG_STEPS[1:]:
        print_row(f'RADIATE in fog, {steps} apart, against single steps', *loops(fog, steps).cells())
    bay = bay_errors(real)
    for session, errors in bay.items():
        print_row(f'the bay, session {session} at the middle of session 1 (m: bins)', *errors.cells())
    back = way_back(real)
    print_head('way back through the car park', 'each scan')
    print_row('m from the nearest of the way there', *[', '.join(f'{value:.0f}' for value in back.away_m)])
    print_row('heading by correlation', ', '.join(f'{value:.0f}°' for value in back.expected_deg))
    print_row('heading by alignment', ', '.join(f'{value:.0f}°' for value in back.headings_deg))
    print_row('score', ', '.join(f'{value:.2f}' for value in back.scores))
    foreign = foreign_scores(real)
    print_head('scores', 'pairs', 'least', 'median', 'most', 'AUROC against other recordings')
    groups = {
        'other recordings': foreign,
        'Oxford, 1 to 3 apart': np.concatenate([oxford_errors(drive, still, n).scores for n in OXFORD_STEPS]),
        'RADIATE in fog, 1 to 8 apart': np.concatenate([there_and_back(fog, n).scores for n in FOG_STEPS]),
        'the bay, session 2 at session 1': bay[2].scores,
        'the car park, the other way': back.scores,
    }
    for name, scores in groups.items():
        told = auroc(np.r_[scores, foreign], np.r_[np.ones(len(scores), bool), np.zeros(len(foreign), bool)])
        cells = (f'{value:.2f}' for value in np.quantile(scores, (0.0, 0.5, 1.0)))
        print_row(name, len(scores), *cells, '' if scores is foreign else f'{told:.3f}')


if __name__ == '__main__':
    main()
