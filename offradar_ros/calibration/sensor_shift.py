"""What one drive says of a sensor: the usual U, and how far apart its descriptors of different places are."""

from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.calibration.encoded_drive import EncodedDrive
from offradar_ros.calibration.open_set import halves, joined_evidence
from offradar_ros.config import ConfidenceConfig
from offradar_ros.recordings.spacing import MAP_SPACING_M
from offradar_ros.retrieval.evidence import evidence_table

ROAD_PLACES = 200
"""Places of a stretch of 1 km. The nearest of many places is nearer than that of few: shipped coefficients come from
halves of such roads."""


def typical_distance(drive: EncodedDrive, tolerance_m: float) -> float | None:
    """The median distance of the nearest place elsewhere, in embedding space; None for a drive of less than 1 km.

    As for shipped coefficients, scans are searched in either half of each kilometre, here in that of their own drive.
    """
    rows = drive.map_rows(MAP_SPACING_M)
    tables = []
    for first in range(0, len(rows) - ROAD_PLACES + 1, ROAD_PLACES):
        road = rows[first : first + ROAD_PLACES]
        tables += [
            evidence_table(drive.places(road[half]), drive.means[road], drive.uncertainties[road], tolerance_m)
            for half in halves(drive.driven_m[road], np.arange(ROAD_PLACES))
        ]
    if not tables:
        return None
    apart = joined_evidence(tables).distance_apart
    apart = apart[np.isfinite(apart)]
    return float(np.median(apart)) if len(apart) else None


def shifted(shipped: ConfidenceConfig, usual_uncertainty: float, typical: float | None) -> ConfidenceConfig:
    """Shipped coefficients for a sensor of this usual U and typical distance (None if unknown).

    The distance of the nearest place counts in units of the typical distance, as in the drives of the fit.
    """
    scale = 1.0 if not typical else shipped.unrelated_distance / typical
    return dataclasses.replace(shipped, usual_uncertainty=usual_uncertainty, distance=shipped.distance * scale)
