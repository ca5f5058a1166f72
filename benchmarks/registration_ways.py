"""Ways to align two scans: ours, and three that are in use elsewhere, each from the whole scan.

Convention of all: the frame of the vehicle, x forward, y to the left (REP 103). Columns of an image from above grow
with x and rows with y, and the vehicle is in the middle.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from offradar_ros.alignment.align import PreparedPlace, PreparedQuery, align, prepare_place, prepare_query
from offradar_ros.alignment.signature import SignatureMaker
from offradar_ros.alignment.signature_code import pack, unpack
from offradar_ros.types import PolarScan

Image = NDArray[np.float32]
Points = NDArray[np.float64]

MIN_RANGE_M = 4.0
"""Returns nearer than this are of the vehicle itself."""


class Found(NamedTuple):
    """Pose of the query in the frame of the place, (3,) float64 of metres and radians, and how sure the way is."""

    pose: NDArray[np.float64]
    score: float


NOTHING = Found(np.zeros(3), 0.0)


class Way(Protocol):
    """A way to align two scans. What belongs to one scan is made once."""

    @property
    def name(self) -> str:
        """For the table."""

    def keep(self, scan: PolarScan) -> Any:
        """What a map keeps of a scan, and a query has."""

    def kept_bytes(self, kept: Any) -> int:
        """How many bytes a map needs for that."""

    def place(self, kept: Any) -> Any:
        """That of a place, ready."""

    def query(self, kept: Any) -> Any:
        """That of a query, ready."""

    def align(self, place: Any, query: Any) -> Found:
        """The pose."""


class Ours:
    """`offradar_ros.alignment`."""

    name = 'ours'

    def __init__(self) -> None:
        self._make = SignatureMaker()

    def keep(self, scan: PolarScan) -> bytes:
        """A packed signature."""
        return pack(self._make(scan))

    def kept_bytes(self, kept: bytes) -> int:
        """Its length."""
        return len(kept)

    def place(self, kept: bytes) -> PreparedPlace:
        """Unpacked and ready."""
        return prepare_place(unpack(kept))

    def query(self, kept: bytes) -> PreparedQuery:
        """Unpacked and ready."""
        return prepare_query(unpack(kept))

    def align(self, place: PreparedPlace, query: PreparedQuery) -> Found:
        """The pose, and the score."""
        found = align(place, query)
        return Found(found.pose, found.score)


def above_noise(scan: PolarScan) -> Image:
    """(A, R) float32 power above the median of its row, in bytes; 0 where there is less, and near the vehicle."""
    power = scan.power.astype(np.float32)
    above = np.maximum(power - np.median(power, axis=1, keepdims=True), 0.0)
    above[:, : math.ceil(MIN_RANGE_M / scan.range_resolution_m)] = 0.0
    return np.asarray(above, np.float32)


@functools.lru_cache(maxsize=4)
def _polar_map(side: int, cell_m: float, rows: int, range_resolution_m: float) -> tuple[Image, Image]:
    """Columns and rows of a scan, wrapped by one row at either end, for each pixel of an image from above."""
    middle_m = (np.arange(side) + 0.5 - side / 2.0) * cell_m
    x_m, y_m = np.meshgrid(middle_m, middle_m)
    turns = np.arctan2(-y_m, x_m) / (2.0 * math.pi) % 1.0
    columns = np.hypot(x_m, y_m) / range_resolution_m - 0.5
    return columns.astype(np.float32), (turns * rows + 1.0).astype(np.float32)


def from_above(scan: PolarScan, side: int, cell_m: float, blur: float) -> Image:
    """(side, side) float32 of the scan's returns, whose azimuths are equally spaced from 0."""
    polar = cv2.GaussianBlur(above_noise(scan), (0, 0), blur) if blur else above_noise(scan)
    wrapped = np.concatenate([polar[-1:], polar, polar[:1]])
    columns, rows = _polar_map(side, cell_m, len(scan.power), scan.range_resolution_m)
    return np.asarray(cv2.remap(wrapped, columns, rows, cv2.INTER_LINEAR), np.float32)


def scan_bytes(kept: PolarScan) -> int:
    """Bytes of a scan as PNG: a way that keeps it can be changed later."""
    _, png = cv2.imencode('.png', kept.power)
    return len(png)


@dataclasses.dataclass(frozen=True)
class FourierMellin:
    """Rotation by phase correlation of log-polar spectra, then translation by phase correlation (Reddy, TIP 1996).

    Attributes:
        side: pixels of the image.
        cell_m: metres of a pixel.
        blur: standard deviation in cells of the scan.
        weakest: bytes above the noise from which a return counts.
        highest: frequency up to which the spectrum counts, as a share of the largest.
    """

    side: int = 512
    cell_m: float = 0.4
    blur: float = 1.0
    weakest: float = 20.0
    highest: float = 0.5

    name = 'Fourier–Mellin'

    class Ready(NamedTuple):
        """The image, and its spectrum by direction and logarithm of the frequency."""

        image: Image
        spectrum: Image

    def keep(self, scan: PolarScan) -> Image:
        """The image from above."""
        image = np.maximum(from_above(scan, self.side, self.cell_m, self.blur) - self.weakest, 0.0)
        return np.asarray(np.sqrt(image), np.float32)

    def kept_bytes(self, kept: Image) -> int:
        """As PNG of eight bits."""
        return len(cv2.imencode('.png', cv2.convertScaleAbs(kept, alpha=255.0 / 16.0))[1])

    def place(self, kept: Image) -> Ready:
        """With its spectrum."""
        zero = self.side // 2
        tapered = (kept - kept.mean()) * cv2.createHanningWindow((self.side, self.side), cv2.CV_32F)
        magnitude = np.fft.fftshift(cv2.magnitude(*cv2.split(cv2.dft(tapered, flags=cv2.DFT_COMPLEX_OUTPUT))))
        strength = (magnitude * _high_pass(self.side)).astype(np.float32)
        flags = cv2.WARP_POLAR_LOG | cv2.INTER_LINEAR
        polar = cv2.warpPolar(strength, (256, 720), (zero, zero), zero * self.highest, flags)[:, 80:]
        tapered = (polar - polar.mean(axis=0)) * np.hanning(polar.shape[1])
        # The other half is the same.
        return self.Ready(kept, np.ascontiguousarray(tapered[:360], np.float32))

    query = place

    def align(self, place: Ready, query: Ready) -> Found:
        """Of both rotations that have such spectra, the one after which the images agree better."""
        (_, down), _ = cv2.phaseCorrelate(query.spectrum, place.spectrum)
        return max((self._shifted(place, query, math.pi * (down / 360.0 + half)) for half in (0, 1)), key=_score)

    def _shifted(self, place: Ready, query: Ready, yaw_rad: float) -> Found:
        middle = self.side / 2.0 - 0.5
        turn = cv2.getRotationMatrix2D((middle, middle), -math.degrees(yaw_rad), 1.0)
        turned = np.asarray(cv2.warpAffine(query.image, turn, query.image.shape), np.float32)
        window = cv2.createHanningWindow((self.side, self.side), cv2.CV_32F)
        (across, down), response = cv2.phaseCorrelate(turned, place.image, window)
        return Found(np.array([across * self.cell_m, down * self.cell_m, _wrapped(yaw_rad)]), response)


def _score(found: Found) -> float:
    return found.score


def _wrapped(angle_rad: float) -> float:
    return math.remainder(angle_rad, 2.0 * math.pi)


@functools.lru_cache(maxsize=2)
def _high_pass(side: int) -> Image:
    """Reddy's filter (1 − c)(2 − c): the lowest frequencies say where the disc ends."""
    cos = np.cos(math.pi * (np.arange(side) / side - 0.5))
    both = np.outer(cos, cos)
    return np.asarray((1.0 - both) * (2.0 - both), np.float32)


@dataclasses.dataclass(frozen=True)
class FeaturePoints:
    """ORB features of the image from above, matched both ways, and RANSAC.

    Attributes:
        side: pixels of the image.
        cell_m: metres of a pixel.
        blur: standard deviation in cells of the scan.
        features: most of an image.
        threshold: of FAST.
        within_m: distance of a match that RANSAC accepts.
    """

    side: int = 512
    cell_m: float = 0.4
    blur: float = 1.0
    features: int = 2000
    threshold: int = 3
    within_m: float = 1.6

    name = 'ORB and RANSAC'

    class Features(NamedTuple):
        """(N, 2) float32 metres, and (N, 32) uint8."""

        points_m: NDArray[np.float32]
        descriptors: NDArray[np.uint8]

    def keep(self, scan: PolarScan) -> Features:
        """The features."""
        image = cv2.convertScaleAbs(np.sqrt(from_above(scan, self.side, self.cell_m, self.blur)), alpha=255.0 / 14.0)
        orb = cv2.ORB.create(self.features, fastThreshold=self.threshold)
        points, descriptors = orb.detectAndCompute(image, None)
        if not points:
            return self.Features(np.empty((0, 2), np.float32), np.empty((0, 32), np.uint8))
        pixels = np.array([point.pt for point in points], np.float32)
        return self.Features((pixels + 0.5 - self.side / 2.0) * self.cell_m, np.asarray(descriptors, np.uint8))

    def kept_bytes(self, kept: Features) -> int:
        """Two bytes for each coordinate, and the descriptors."""
        return 4 * len(kept.points_m) + kept.descriptors.size

    def place(self, kept: Features) -> Features:
        """The same."""
        return kept

    query = place

    def align(self, place: Features, query: Features) -> Found:
        """The similarity that most matches agree with; its scale, which is near 1, is left out."""
        if min(len(place.points_m), len(query.points_m)) < 3:
            return NOTHING
        matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(query.descriptors, place.descriptors)
        if len(matches) < 3:
            return NOTHING
        source = query.points_m[[match.queryIdx for match in matches]]
        target = place.points_m[[match.trainIdx for match in matches]]
        cv2.setRNGSeed(1)
        matrix, inliers = cv2.estimateAffinePartial2D(
            source, target, method=cv2.RANSAC, ransacReprojThreshold=self.within_m, maxIters=4000, confidence=0.999
        )
        if matrix is None:
            return NOTHING
        kept = inliers.ravel().astype(bool)
        return Found(_rigid(source[kept].astype(np.float64), target[kept].astype(np.float64)), float(kept.sum()))


def _rigid(source: Points, target: Points) -> NDArray[np.float64]:
    """The pose that brings points (N, 2) nearest to others, by least squares (Kabsch)."""
    from_mean, to_mean = source.mean(axis=0), target.mean(axis=0)
    a, b = source - from_mean, target - to_mean
    yaw_rad = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    shift = to_mean - np.array([[cos, -sin], [sin, cos]]) @ from_mean
    return np.array([*shift, yaw_rad])


@dataclasses.dataclass(frozen=True)
class CfarIcp:
    """Points by CFAR, and point-to-line ICP from headings all around.

    Attributes:
        guard: cells beside a cell that are left out of the mean of its neighbours, ...
        reference: ... cells beyond these that are in it, ...
        above: ... and how many bytes above that mean a return is.
        strongest: most points of an azimuth.
        reach_m: farthest range.
        starts: headings that are tried with few points.
        refined: how many of them are refined with all.
        last_m: distance to a line that counts half, in the end.
    """

    guard: int = 3
    reference: int = 24
    above: float = 45.0
    strongest: int = 4
    reach_m: float = 100.0
    starts: int = 24
    refined: int = 4
    last_m: float = 0.6

    name = 'CFAR and point-to-line ICP'

    class Lines(NamedTuple):
        """(N, 2) float64 points in metres, their tree, and (N, 2) normals."""

        points_m: Points
        tree: Any
        normals: Points

    def keep(self, scan: PolarScan) -> Points:
        """(N, 2) float64 points."""
        power = above_noise(scan)
        power = power[:, : round(self.reach_m / scan.range_resolution_m)]
        smooth = cv2.GaussianBlur(power, (0, 0), 1.0)
        half = self.guard + self.reference
        total = cv2.blur(power, (2 * half + 1, 1)) * (2 * half + 1)
        near = cv2.blur(power, (2 * self.guard + 1, 1)) * (2 * self.guard + 1)
        mean = (total - near) / (2.0 * self.reference)
        peak = smooth >= cv2.dilate(smooth, np.ones((1, 3), np.uint8))
        strength = np.where(peak & (smooth > mean + self.above), smooth, 0.0)
        columns = np.argpartition(-strength, self.strongest, axis=1)[:, : self.strongest]
        rows = np.arange(len(strength))[:, None].repeat(self.strongest, axis=1)
        valid = strength[rows, columns] > 0.0
        rows, columns = rows[valid], columns[valid]
        # A parabola through the peak and its neighbours.
        columns = np.clip(columns, 1, strength.shape[1] - 2)
        left, here, right = (smooth[rows, columns + step] for step in (-1, 0, 1))
        curve = np.minimum(left - 2.0 * here + right, -1e-3)
        range_m = (columns + 0.5 + np.clip(0.5 * (left - right) / curve, -0.5, 0.5)) * scan.range_resolution_m
        angle = -2.0 * math.pi * rows / len(power)
        return np.column_stack([range_m * np.cos(angle), range_m * np.sin(angle)]).astype(np.float64)

    def kept_bytes(self, kept: Points) -> int:
        """Two bytes for each coordinate."""
        return 4 * len(kept)

    def place(self, kept: Points) -> Lines:
        """With a tree, and with normals from each one's eight nearest neighbours."""
        if len(kept) < 9:
            return self.Lines(kept, None, np.zeros_like(kept))
        tree = cKDTree(kept)
        _, nearest = tree.query(kept, k=9)
        spread = kept[nearest] - kept[nearest].mean(axis=1, keepdims=True)
        _, axes = np.linalg.eigh(np.einsum('nki,nkj->nij', spread, spread))
        return self.Lines(kept, tree, axes[:, :, 0])

    def query(self, kept: Points) -> Points:
        """The same."""
        return kept

    def align(self, place: Lines, query: Points) -> Found:
        """The best of all starts; the score is the share of the points that lie near a line, as in the place."""
        if place.tree is None or len(query) < 9:
            return NOTHING
        few = query[:: max(1, len(query) // 250)]
        yaws = np.arange(self.starts) * 2.0 * math.pi / self.starts
        rough = [self._icp(place, few, np.array([0.0, 0.0, yaw]), (8.0, 6.0, 4.0, 3.0, 2.0)) for yaw in yaws]
        best = sorted(rough, key=_score, reverse=True)[: self.refined]
        last = [self._icp(place, query, found.pose, (2.0,) * 4 + (1.0,) * 4 + (self.last_m,) * 6) for found in best]
        return max(last, key=_score)

    def _icp(self, place: Lines, points: Points, pose: NDArray[np.float64], within_m: tuple[float, ...]) -> Found:
        for limit_m in within_m:
            moved, rotation = _moved(points, pose)
            distance, nearest = place.tree.query(moved, distance_upper_bound=3.0 * limit_m)
            near = np.isfinite(distance)
            if np.count_nonzero(near) < 6:
                return Found(pose, 0.0)
            normals, lines = place.normals[nearest[near]], place.points_m[nearest[near]]
            off = np.einsum('ni,ni->n', normals, lines - moved[near])
            turned = points[near] @ rotation.T
            slope = normals[:, 1] * turned[:, 0] - normals[:, 0] * turned[:, 1]
            terms = np.column_stack([normals, slope])
            weights = 1.0 / (1.0 + (distance[near] / limit_m) ** 2) ** 2
            normal = (terms * weights[:, None]).T @ terms + 1e-6 * np.eye(3)
            pose = pose + np.linalg.solve(normal, terms.T @ (weights * off))
        moved, _ = _moved(points, pose)
        distance, _ = place.tree.query(moved, distance_upper_bound=3.0 * within_m[-1])
        agreeing = float(np.mean(1.0 / (1.0 + (distance / within_m[-1]) ** 2)))
        return Found(np.array([pose[0], pose[1], _wrapped(pose[2])]), agreeing)


def _moved(points: Points, pose: NDArray[np.float64]) -> tuple[Points, NDArray[np.float64]]:
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    rotation = np.array([[cos, -sin], [sin, cos]])
    return points @ rotation.T + pose[:2], rotation


WAYS: tuple[Way, ...] = (Ours(), FourierMellin(), FeaturePoints(), CfarIcp())
