"""An evaluation without simulation: poses along a street, with artificial descriptors."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import math

import numpy as np

from offradar_ros.config import ConfidenceConfig
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import Pair, Rules, search_drive_map
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.gate import Gate
from offradar_ros.lab.evaluation.left_out import maps_of, stretch_m
from offradar_ros.lab.evaluation.maintenance import ablate, merge_plans
from offradar_ros.lab.evaluation.protocol import Group, Lane, Protocol, Validation
from offradar_ros.lab.evaluation.results.arrays import map_arrays, scan_rows
from offradar_ros.lab.evaluation.results.assemble import assemble
from offradar_ros.lab.evaluation.results.method import Cost
from offradar_ros.lab.evaluation.results.results import Results
from offradar_ros.lab.evaluation.results.uncertainty import ConditionFigures, RecordedUncertainty
from offradar_ros.lab.evaluation.runner import Measured, Worlds
from offradar_ros.lab.evaluation.thresholds import thresholds_from
from offradar_ros.types import PolarScan


def street_drive(index: int, count: int, *, seed: int = 0, degraded: float = 0.4, noise: float = 0.4) -> EmbeddedDrive:
    """Scans 4 m apart: each descriptor is that of the place, plus noise that grows with the severity, as U does."""
    rng = np.random.default_rng([seed, index])
    driven_m = 4.0 * np.arange(count, dtype=np.float64)
    bad = rng.random(count) < degraded
    severities = np.where(bad, rng.uniform(0.05, 1.0, count), 0.0)
    kinds = np.where(bad, rng.choice(['blocked', 'flooded'], count), '')
    waves = np.random.default_rng(5).uniform(0.01, 0.2, 24)
    places = np.cos(driven_m[:, None] * waves)
    means = places + rng.normal(0.0, 1.0, places.shape) * (0.05 + noise * severities[:, None] * 4.0)
    poses = np.column_stack([driven_m, np.full(count, 1.0 * index), np.zeros(count)])
    power = np.random.default_rng(index).integers(0, 90, (count, 40, 64), np.uint8)
    azimuths_rad = np.arange(40) / 40 * 2 * np.pi
    drive = Drive(
        name=f'street_{index + 1}',
        group='streets',
        world='street',
        index=index,
        key=f'street_{index}_{seed}',
        stamps_ns=np.arange(count, dtype=np.int64) * 10**9 + index * 10**14,
        poses=poses,
        driven_m=driven_m,
        kinds=kinds,
        severities=severities,
        read_scan=lambda row: PolarScan(row * 10**9 + index * 10**14, power[row], azimuths_rad, 1.0),
    )
    uncertainties = 0.3 + severities + rng.normal(0.0, 0.05, count)
    return EmbeddedDrive(drive, means.astype(np.float32), uncertainties)


SMALL_PROTOCOL = Protocol(
    name='small',
    title='One street',
    groups=(Group('streets', 'a street', 'drawn', cities=(7,)),),
    lanes=(Lane(), Lane(1.0), Lane(-1.0)),
    validation=Validation((8,)),
    resamples=20,
)

THRESHOLDS = thresholds_from([0.3, 0.35, 0.4], Validation((8,), levels=7))


COEFFICIENTS = ConfidenceConfig(
    model='ours', intercept=2.0, distance=-0.5, spatial_ratio=-4.0, uncertainty=-0.5, unrelated_distance=6.0
)


def measure_street(name: str, drives: list[EmbeddedDrive], protocol: Protocol) -> Measured:
    """What the runner measures of a method with these embeddings."""
    found, ablations = [], {}
    for spacing_m in protocol.map_spacings_m:
        for (a, b), number in itertools.product(itertools.permutations(drives, 2), maps_of(protocol)):
            pair = Pair(name, 'streets', 'street', a.drive.index, b.drive.index, spacing_m, number)
            found.append(search_drive_map(pair, a, b, Rules(), stretch_m(protocol, a.drive)))
        if protocol.leaves_out:
            continue
        by_pair = {(a.pair.map_index, a.pair.query_index): a for a in found if a.pair.spacing_m == spacing_m}
        ablations['streets', spacing_m] = [
            ablate(by_pair[m.drive.index, q.drive.index], m, between, q, protocol.maintenance, Rules(), 0)
            for m, between, q in merge_plans(drives)
        ]
    info = ModelInfo(name, fingerprint_of(name), 24, {'settings': '{}'})
    cost = Cost(1.5, math.nan, 96.0, 100.0)
    gate = Gate(COEFFICIENTS if name == 'ours' else None, 0.9, THRESHOLDS.deployed)
    return Measured(name, f'runs/{name}.safetensors', False, info, found, ablations, THRESHOLDS, gate, cost)


def fingerprint_of(name: str) -> str:
    """The fingerprint of a method's model."""
    return hashlib.sha256(name.encode()).hexdigest()


@dataclasses.dataclass(frozen=True)
class StreetEvaluation:
    """Results of ours and STUN on one street, and what they are computed from."""

    results: Results
    measured: list[Measured]
    worlds: Worlds


def evaluate_street(protocol: Protocol = SMALL_PROTOCOL) -> StreetEvaluation:
    """An evaluation of three drives of 60 scans."""
    ours = [street_drive(index, 60) for index in range(3)]
    # The same descriptors for STUN, with a U that is independent of them.
    rng = np.random.default_rng(0)
    stun = [dataclasses.replace(drive, uncertainties=rng.random(60)) for drive in ours]
    measured = [measure_street('ours', ours, protocol), measure_street('stun', stun, protocol)]
    worlds = {('streets', 'street'): [drive.drive for drive in ours]}
    conditions = {
        name: ConditionFigures(11, mean, 0.1, 0.9, 0.5, math.nan)
        for name, mean in (('clean', 0.5), ('fog', 0.6), ('blocked_50', 0.4))
    }
    results = assemble(
        measured,
        worlds,
        protocol,
        scan_rows(measured, worlds),
        map_arrays(measured),
        command='offradar evaluate …',
        skipped=['kaist: not given'],
        recorded=RecordedUncertainty('sunny', {'fog': 'foggy'}, {'ours': conditions, 'stun': conditions}),
    )
    return StreetEvaluation(results, measured, worlds)
