"""The frozen records that pass through the pipeline. No input or output here.

Conventions of the whole package:

* Stamps are integer nanoseconds since the Unix epoch (`stamp_ns`).
* Polar power is `(azimuths, range_bins)` uint8, row = azimuth, column = range bin. Azimuth 0 is the sensor's forward
  axis and azimuths grow **clockwise seen from above** (Navtech). Bin k is centred at
  ``range_offset_m + (k + 0.5) * range_resolution_m``.
* Map coordinates are metres in a local east-north-up frame named ``map`` (REP 103, REP 105); `yaw_rad` is
  counter-clockwise from east.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PolarScan:
    """One full (or partial) rotation of a spinning radar.

    Attributes:
        stamp_ns: the scan's stamp from its source (file name or message header).
        power: (A, R) uint8 received power in the sensor's own units (0.5 dB steps for Navtech).
        azimuths_rad: (A,) float64 in [0, 2π), clockwise from forward, one for each row.
        range_resolution_m: metres for each range bin.
        range_offset_m: metres added to every range.
        azimuth_stamps_ns: (A,) int64 measurement time of each row, or None if the source has none.
        row_faults: number of rows by what was wrong with them: ``angle_interpolated``, ``stamp_interpolated``,
            ``stamp_unusable`` (the stamp of the scan is in its place), ``no_power``, ``saturated``, ``damaged``,
            ``missing`` (of `radar.azimuth_samples`, and the others are the first of a turn).
    """

    stamp_ns: int
    power: NDArray[np.uint8]
    azimuths_rad: NDArray[np.float64]
    range_resolution_m: float
    range_offset_m: float = 0.0
    azimuth_stamps_ns: NDArray[np.int64] | None = None
    row_faults: Mapping[str, int] = dataclasses.field(default_factory=dict)

    @property
    def max_range_m(self) -> float:
        """Far edge of the last range bin, metres."""
        return self.range_offset_m + int(self.power.shape[1]) * self.range_resolution_m


@dataclasses.dataclass(frozen=True, slots=True)
class Pose:
    """A position, and the heading if known, in the ``map`` frame (ENU metres; yaw in radians, NaN when unknown).

    `yaw_sd_rad` is the standard deviation of the heading, NaN where that is unknown.
    """

    x_m: float
    y_m: float
    z_m: float = 0.0
    yaw_rad: float = math.nan
    # Not compared: NaN is unequal to NaN, and two poses are one wherever they point to the same place.
    yaw_sd_rad: float = dataclasses.field(default=math.nan, compare=False)


MAX_SIGNATURE_BYTES = 8192
"""Most bytes of a packed signature."""


class ScanKey(NamedTuple):
    """Names a mapped scan, wherever the map holds it: the session that it was mapped in, and its stamp."""

    session_id: int
    stamp_ns: int


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Embedding:
    """Output of an encoder for one scan: a mean to search with, and its variance.

    Attributes:
        stamp_ns: the stamp of the scan.
        mean: (d,) float32, the descriptor compared by Euclidean distance.
        variance: (d,) float32, the diagonal of Σ (Sec. III-C of the paper), prior at 1.
        model: fingerprint (SHA-256, hex) of the model; embeddings of different models are never compared.
        signature: the signature of the scan, packed, at most `MAX_SIGNATURE_BYTES`; empty if it has none.
    """

    stamp_ns: int
    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    model: str = ''
    signature: bytes = b''

    @property
    def uncertainty(self) -> float:
        """U = (1/d) Σ_i Σ_ii, the paper's scalar uncertainty; 1 is the prior."""
        return float(np.mean(self.variance, dtype=np.float64))


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Place:
    """One entry of the parent map: (μ_i, U_i, D_i) of Algorithm 1, with session and stamp of the scan it holds."""

    place_id: int
    session_id: int
    stamp_ns: int
    pose: Pose
    uncertainty: float
    mean: NDArray[np.float32]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class PlaceTable:
    """Many places as columns, one place in each row; the form in which the map is published and searched.

    Attributes:
        place_ids: (N,) int64.
        session_ids: (N,) int32, session of the scan that the place holds.
        stamps_ns: (N,) int64, stamp of that scan.
        positions_m: (N, 3) float64 in the ``map`` frame.
        yaws_rad: (N,) float64, NaN where unknown.
        yaw_sds_rad: (N,) float32, standard deviations of the headings, NaN where unknown.
        uncertainties: (N,) float32, U of that scan.
        means: (N, d) float32.
    """

    place_ids: NDArray[np.int64]
    session_ids: NDArray[np.int32]
    stamps_ns: NDArray[np.int64]
    positions_m: NDArray[np.float64]
    yaws_rad: NDArray[np.float64]
    yaw_sds_rad: NDArray[np.float32]
    uncertainties: NDArray[np.float32]
    means: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.place_ids)

    def scans(self) -> list[ScanKey]:
        """The N scans that the places hold."""
        return list(map(ScanKey, self.session_ids.tolist(), self.stamps_ns.tolist()))

    @classmethod
    def from_places(cls, places: Sequence[Place], dimension: int) -> PlaceTable:
        """Columns of `places`, in their order; `dimension` gives the shape of an empty table."""
        return cls(
            place_ids=np.array([p.place_id for p in places], np.int64),
            session_ids=np.array([p.session_id for p in places], np.int32),
            stamps_ns=np.array([p.stamp_ns for p in places], np.int64),
            positions_m=np.array([(p.pose.x_m, p.pose.y_m, p.pose.z_m) for p in places], np.float64).reshape(-1, 3),
            yaws_rad=np.array([p.pose.yaw_rad for p in places], np.float64),
            yaw_sds_rad=np.array([p.pose.yaw_sd_rad for p in places], np.float32),
            uncertainties=np.array([p.uncertainty for p in places], np.float32),
            means=np.array([p.mean for p in places], np.float32).reshape(len(places), dimension),
        )


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Where a query was taken, seen from the scan of a place.

    Attributes:
        pose: (3,) float64: x forward and y to the left in metres, yaw counter-clockwise in radians, of the query's
            vehicle in the frame of the place's vehicle, each at its stamp.
        covariance: (3, 3) float64 of the pose in m², m·rad and rad². It holds for right alignments; which are wrong is
            for the score to say.
        score: mean correlation of the two scans there, over the edges in each patch of the query, −1 to 1. Where they
            do not agree at all, 0 or less, the pose is that of the place, and the covariance that of no knowledge.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    score: float


@dataclasses.dataclass(frozen=True, slots=True)
class Candidate:
    """A place that a query resembles.

    Attributes:
        distance: Euclidean, in embedding space.
        uncertainty: U of the scan that the place holds.
        pose: of the vehicle when that scan was taken.
        alignment: of the query with that scan; None where they were not aligned.
    """

    place_id: int
    distance: float
    uncertainty: float
    pose: Pose
    alignment: Alignment | None = None


@dataclasses.dataclass(frozen=True, slots=True)
class Evidence:
    """What is known about the nearest place of a query. Distances are Euclidean, in embedding space.

    Attributes:
        distance: d₁, from the query to the nearest place.
        distance_apart: from the query to the nearest place that is more than the tolerance away from the first one on
            the ground; infinite if there is none.
        place_distance_apart: from the nearest place itself to the nearest other such place; infinite if there is none.
        uncertainty: U of the query.
        place_uncertainty: U of the scan that the place holds.
    """

    distance: float
    distance_apart: float
    place_distance_apart: float
    uncertainty: float
    place_uncertainty: float


@dataclasses.dataclass(frozen=True, slots=True)
class Match:
    """An accepted query and its places, the likeliest first: the nearest, unless alignments order them otherwise.

    `p_right` is the probability that the first place is within the tolerance of the vehicle, from the evidence; NaN
    where none is calibrated for the model. `threshold` is that of the paper's rule, on U.
    """

    stamp_ns: int
    uncertainty: float
    threshold: float
    candidates: tuple[Candidate, ...]
    p_right: float = math.nan
    evidence: Evidence | None = None


class Reason(str, enum.Enum):
    """Why a query was rejected."""

    UNCERTAIN = 'uncertain'
    UNKNOWN_PLACE = 'unknown_place'
    AMBIGUOUS = 'ambiguous'
    UNVERIFIED = 'unverified'
    INVALID_EMBEDDING = 'invalid_embedding'
    MAP_EMPTY = 'map_empty'
    WRONG_MODEL = 'wrong_model'


@dataclasses.dataclass(frozen=True, slots=True)
class Rejection:
    """A rejected query, with the places that a match would have had.

    `uncertainty` is NaN for an invalid embedding; `detail` is one line for people. `p_right` and `evidence` are as in a
    match, for the first of the places; NaN and None where there is none.
    """

    stamp_ns: int
    reason: Reason
    uncertainty: float
    threshold: float
    candidates: tuple[Candidate, ...]
    detail: str
    p_right: float = math.nan
    evidence: Evidence | None = None


Outcome = Match | Rejection


class LocalisationState(str, enum.Enum):
    """What the belief over the map has decided (see `PlaceBelief`)."""

    ON_MAP = 'on_map'
    OFF_MAP = 'off_map'
    UNSURE = 'unsure'
    LOST = 'lost'


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Localisation:
    """Where the vehicle is after all scans up to a stamp.

    Attributes:
        stamp_ns: the stamp of the last scan.
        state: what is decided.
        p_on_map: probability that the vehicle is at any place of the map; 1 − `p_on_map` is that of off the map.
        place_id: the best place, around which the probability is largest; None if the map is empty.
        p_here: probability that the vehicle is within the tolerance of the best place.
        position_m: (2,) float64 in the ``map`` frame, mean of the places within the tolerance of the best one, weighted
            by their probability; NaN if the map is empty.
        covariance_m2: (2, 2) float64 of that position, given that the vehicle is there; NaN if the map is empty.
    """

    stamp_ns: int
    state: LocalisationState
    p_on_map: float
    place_id: int | None
    p_here: float
    position_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
