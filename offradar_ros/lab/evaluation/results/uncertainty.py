"""The distribution of U over scans."""

from __future__ import annotations

import dataclasses

from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class UncertaintyFigures:
    """U of one method over the query scans of a group, each scan once; NaN where no scan has a finite U.

    Attributes:
        scans: number of scans.
        refused: number of scans that the encoder refused, whose U is infinite; the other figures are without them.
        mean: of U.
        least: lowest U.
        quantile_05: 5 % of the scans are below it.
        median: of U.
        quantile_95: 5 % of the scans are above it.
        greatest: highest U.
        mean_by_kind: mean U by kind of degradation, and of ``clean`` scans, or ``recorded`` ones of unknown severity.
        spearman_severity: rank correlation of U with severity over ``all`` scans, and over the degraded scans of each
            kind.
    """

    scans: int
    refused: int
    mean: Measure
    least: Measure
    quantile_05: Measure
    median: Measure
    quantile_95: Measure
    greatest: Measure
    mean_by_kind: dict[str, Measure]
    spearman_severity: dict[str, Measure]


@dataclasses.dataclass(frozen=True)
class ConditionFigures:
    """U of recorded scans in one condition.

    Attributes:
        scans: number of scans.
        mean: of U; infinite if the encoder refused a scan, as are the next two; they are NaN when read from a file.
        least: lowest U.
        greatest: highest U.
        above_every_clean: share of the scans whose U exceeds that of every clean scan.
        above_own: share of the scans whose U exceeds that of the same scan before it was degraded; NaN for others.
    """

    scans: int
    mean: Measure
    least: Measure
    greatest: Measure
    above_every_clean: Measure
    above_own: Measure


@dataclasses.dataclass(frozen=True)
class RecordedUncertainty:
    """U of recorded scans: of clean ones, of the same with faults added to their bytes, and of other recordings.

    Attributes:
        clean: name of the recording whose scans are taken to be clean.
        compared: names of the other recordings, by condition.
        methods: figures by method, then by condition: ``clean``, each degradation, each of `compared`.
    """

    clean: str
    compared: dict[str, str]
    methods: dict[str, dict[str, ConditionFigures]]
