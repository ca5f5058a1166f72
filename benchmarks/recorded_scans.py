"""Recordings that are not data sets of the package, read as the notes of their folders ask, and their positions.

None has positions: they are found by correlation of scans, in the frame of one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scan_registration import Motion, Registration, strongest

from offradar_ros.types import PolarScan

Power = NDArray[np.uint8]
Positions = NDArray[np.float64]

BAY_BINS = 86
"""Sessions 1 and 2 hold no power beyond this bin; session 3 does, which gives away whose scan it is."""
CELL_M = 3.125
"""Side of a cell of the images of the car park."""
USABLE_BINS = 173
_LEAST_POWER = 24
_BLANK_BINS = 8


def bay_sessions(real: Path) -> dict[int, Power]:
    """Power (scans, 250, 173) uint8 of sessions 1, 2 and 3 of `ipslam`: whole scans, powers below 24 set to 0."""
    with np.load(real / 'ipslam' / 'sessions_1_2.npz') as first, np.load(real / 'ipslam' / 'session_3.npz') as third:
        whole = third['scan'][third['spokes'] == third['scan'].shape[1]]
        sessions = {1: first['scan1'][1:], 2: first['scan2'], 3: whole[14:]}
    usable = {number: power[:, :, :USABLE_BINS] for number, power in sessions.items()}
    return {number: np.where(power < _LEAST_POWER, 0, power).astype(np.uint8) for number, power in usable.items()}


def evenly_spaced(power: Power, bin_m: float) -> list[PolarScan]:
    """Scans of power (scans, A, R) with A equally spaced azimuths from 0; the stamps are their numbers."""
    azimuths_rad = np.arange(power.shape[1]) * 2.0 * np.pi / power.shape[1]
    return [PolarScan(number, rows, azimuths_rad, bin_m) for number, rows in enumerate(power)]


def bay_motions(sessions: dict[int, Power]) -> dict[int, list[Motion]]:
    """Each scan in the frame of the middle scan of session 1, in bins.

    Sessions 1 and 2 are compared with that scan itself; session 3 is followed from it.
    """
    scans = {number: evenly_spaced(power, 1.0) for number, power in sessions.items()}
    reference = scans[1][len(scans[1]) // 2]
    registration = Registration(64.0, _BLANK_BINS)
    found = {number: [registration.motion(reference, scan) for scan in scans[number]] for number in (1, 2)}
    return found | {3: list(registration.follow(scans[3], reference))}


def bay_scores(sessions: dict[int, Power]) -> dict[str, NDArray[np.float64]]:
    """Correlations of scans with the middle scan of session 1, after the motion that fits best.

    The same scans mirrored, which are of no place, are for comparison.
    """
    reference = evenly_spaced(sessions[1], 1.0)[len(sessions[1]) // 2]
    registration = Registration(64.0, _BLANK_BINS)
    compared = {'session 2': sessions[2], 'session 3, first tenth': sessions[3][: len(sessions[3]) // 10]}
    mirrored = {f'{name}, mirrored': power[:, ::-1] for name, power in compared.items()}
    return {
        name: np.array([registration.motion(reference, scan).score for scan in evenly_spaced(power, 1.0)])
        for name, power in (compared | mirrored).items()
    }


def car_park(real: Path, azimuths: int = 400) -> list[PolarScan]:
    """The scans of `raplace_examples` with 128 bins of half a cell; azimuth 0 is the x axis of their images.

    In these images x is r cos θ to the right and y is r sin θ down, so that θ grows clockwise.
    """
    with np.load(real / 'raplace_examples' / 'scans.npz') as file:
        images = file['cartesian']
    side = images.shape[1]
    theta = np.arange(azimuths)[:, np.newaxis] * 2.0 * np.pi / azimuths
    ranges = (np.arange(side)[np.newaxis, :] + 0.5) / 2.0
    column = (side / 2 - 0.5 + ranges * np.cos(theta)).astype(np.float32)
    row = (side / 2 - 0.5 + ranges * np.sin(theta)).astype(np.float32)
    return evenly_spaced(np.stack([cv2.remap(image, column, row, cv2.INTER_LINEAR) for image in images]), CELL_M / 2.0)


def car_park_motions(scans: Sequence[PolarScan]) -> list[Motion]:
    """Each scan in the frame of the first one, metres."""
    loud = [strongest(scan, 0.2) for scan in scans]
    return list(Registration(100.0, 2.0 * CELL_M).follow(loud, loud[0]))


def positions(motions: Sequence[Motion]) -> Positions:
    """(scans, 2) float64 forward and right, in the unit of the motions."""
    return np.array([(motion.forward_m, motion.right_m) for motion in motions])
