from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from radar_images import read_image

from offradar_ros.config import RingKeyConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.errors import ConfigError, RefusedInput
from offradar_ros.types import PolarScan

CONFIG = RingKeyConfig(rings=32, max_range_m=128.0, variance_scale=1.0)


def with_power(scan: PolarScan, power: np.ndarray) -> PolarScan:
    return dataclasses.replace(scan, power=power)


def rolled(scan: PolarScan, rows: int) -> PolarScan:
    return with_power(scan, np.roll(scan.power, rows, axis=0))


def slow_embedding(scan: PolarScan, config: RingKeyConfig) -> tuple[np.ndarray, np.ndarray]:
    """Key and variance in loops; a ring must be a whole number of bins, and a sector of rows."""
    rings, width = config.rings, config.max_range_m / config.rings
    rows = []
    for row in scan.power.astype(float):
        ring = np.zeros(rings)
        for k, value in enumerate(row):
            centre = (k + 0.5) * scan.range_resolution_m
            if config.min_range_m <= centre < config.max_range_m:
                ring[int(centre / width)] += value
        norm = np.sqrt(sum(v * v for v in ring))
        rows.append(ring / norm if norm else ring)
    each = len(rows) // config.sectors
    sectors = [np.mean([rows[(s + r) % len(rows)] for r in range(each)], axis=0) for s in range(len(rows))]
    variance = np.zeros(rings)
    for i in range(rings):
        steps = [key[i] - (key[i - 1] if i else 0.0) for key in sectors]
        middle = sum(steps) / len(steps)
        spread = sum((step - middle) ** 2 for step in steps) / len(steps)
        variance[i] = config.variance_scale / (1 + 64 * rings * spread)
    return np.mean(rows, axis=0), variance


def test_matches_a_slow_implementation(street: PolarScan) -> None:
    config = dataclasses.replace(CONFIG, variance_scale=2.5)
    embedding = RingKeyEncoder(config).encode(street)
    mean, variance = slow_embedding(street, config)
    np.testing.assert_allclose(embedding.mean, mean, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(embedding.variance, variance, rtol=1e-5)


def test_is_an_encoder_of_float32_vectors(street: PolarScan) -> None:
    encoder = RingKeyEncoder(CONFIG)
    embedding = encoder.encode(street)
    assert isinstance(encoder, Encoder)
    assert embedding.mean.shape == embedding.variance.shape == (encoder.info.dimension,) == (32,)
    assert embedding.mean.dtype == embedding.variance.dtype == np.float32
    assert embedding.stamp_ns == street.stamp_ns
    assert embedding.model == encoder.info.fingerprint


@pytest.mark.parametrize('rows', [1, 7, 19, 20, 133, 240, 399])
def test_a_turn_on_the_spot_changes_nothing(street: PolarScan, rows: int) -> None:
    encoder = RingKeyEncoder(CONFIG)
    still, turned = encoder.encode(street), encoder.encode(rolled(street, rows))
    np.testing.assert_array_equal(turned.mean, still.mean)
    np.testing.assert_array_equal(turned.variance, still.variance)


def test_gain_changes_nothing() -> None:
    power = np.random.default_rng(2).integers(0, 100, (40, 256), dtype=np.uint8)
    scan = PolarScan(0, power, np.arange(40.0), 0.5)
    encoder = RingKeyEncoder(CONFIG)
    np.testing.assert_array_equal(encoder.encode(scan).mean, encoder.encode(with_power(scan, power * 2)).mean)


def test_sensors_of_other_resolutions_give_comparable_keys(street: PolarScan) -> None:
    finer = dataclasses.replace(street, power=street.power.repeat(3, axis=1), range_resolution_m=0.5 / 3)
    encoder = RingKeyEncoder(CONFIG)
    np.testing.assert_allclose(encoder.encode(finer).mean, encoder.encode(street).mean, atol=1e-6)


@pytest.mark.parametrize('rows', [1, 5, 250, 399])
def test_partial_rotations_are_encoded(street: PolarScan, rows: int) -> None:
    embedding = RingKeyEncoder(CONFIG).encode(with_power(street, street.power[:rows]))
    assert np.isfinite(embedding.mean).all()
    assert np.all((embedding.variance > 0) & (embedding.variance <= 1))


def test_rows_without_power_count_as_zero(street: PolarScan) -> None:
    power = street.power.copy()
    power[::2] = 0
    encoder = RingKeyEncoder(CONFIG)
    half = encoder.encode(with_power(street, power)).mean
    np.testing.assert_allclose(2 * half, encoder.encode(with_power(street, street.power[1::2])).mean, rtol=1e-6)


def test_equal_sectors_give_the_prior_in_each_ring(street: PolarScan) -> None:
    same = with_power(street, np.tile(street.power[:1], (400, 1)))
    np.testing.assert_array_equal(RingKeyEncoder(CONFIG).encode(same).variance, 1.0)


def test_variance_scale_scales_only_the_variance(street: PolarScan) -> None:
    one = RingKeyEncoder(CONFIG).encode(street)
    two = RingKeyEncoder(dataclasses.replace(CONFIG, variance_scale=2.0)).encode(street)
    np.testing.assert_array_equal(two.mean, one.mean)
    np.testing.assert_array_equal(two.variance, 2 * one.variance)


@pytest.mark.parametrize('field', [field.name for field in dataclasses.fields(RingKeyConfig)])
def test_every_setting_is_part_of_the_fingerprint(field: str) -> None:
    changed = dataclasses.replace(CONFIG, **{field: getattr(CONFIG, field) * 2})
    assert RingKeyEncoder(changed).info.fingerprint != RingKeyEncoder(CONFIG).info.fingerprint


@pytest.mark.parametrize('shape', [(0, 0), (0, 300), (400, 0), (400, 300)])
def test_scans_without_signal_are_refused(shape: tuple[int, int]) -> None:
    scan = PolarScan(5, np.zeros(shape, np.uint8), np.arange(float(shape[0])), 0.5)
    with pytest.raises(RefusedInput, match='scan at 5 ns') as refused:
        RingKeyEncoder(CONFIG).encode(scan)
    assert refused.value.cause == 'no_signal'


def test_signal_outside_the_rings_is_no_signal(street: PolarScan) -> None:
    power = np.zeros_like(street.power)
    power[:, :5] = power[:, 256:] = 200
    with pytest.raises(RefusedInput, match=r'between 2\.5 m and 128 m'):
        RingKeyEncoder(CONFIG).encode(with_power(street, power))


def test_rings_that_would_be_empty_are_refused() -> None:
    with pytest.raises(ConfigError, match=r'encoder\.ring_key\.min_range_m'):
        RingKeyEncoder(RingKeyConfig(min_range_m=30.0, max_range_m=20.0))


def blocked(power: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    out = np.array(power)
    out[: round(share * len(power))] = 0
    return out


def with_noise(power: NDArray[np.uint8], level: float) -> NDArray[np.uint8]:
    noise = np.random.default_rng(4).exponential(level, power.shape)
    return np.asarray(np.minimum(power + noise, 255), np.uint8)


def saturated(power: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    rng = np.random.default_rng(5)
    out = np.array(power)
    for row in rng.choice(len(power), round(share * len(power)), replace=False):
        out[row, rng.integers(0, power.shape[1] // 4) :] = 220
    return out


def attenuated(power: NDArray[np.uint8], loss_at_end: float) -> NDArray[np.uint8]:
    """Attenuation with range, in the sensor's logarithmic units, down to the noise of the far range."""
    floor = np.random.default_rng(6).permutation(power[:, power.shape[1] * 85 // 100 :].reshape(-1))
    loss = loss_at_end * np.arange(power.shape[1]) / power.shape[1]
    return np.asarray(np.maximum(np.maximum(power - loss, 0), np.resize(floor, power.shape)), np.uint8)


DEGRADATIONS = [
    pytest.param(blocked, (0.2, 0.35, 0.5, 0.7), id='blocked sector'),
    pytest.param(with_noise, (10.0, 20.0, 40.0, 80.0), id='noise'),
    pytest.param(saturated, (0.1, 0.2, 0.4, 0.8), id='saturated azimuths'),
    pytest.param(attenuated, (20.0, 40.0, 80.0), id='rain'),
]


def oxford(folder: Path) -> list[PolarScan]:
    images = map(read_image, sorted(folder.glob('oxford_tiny/radar/*.png')))
    return [PolarScan(i, image[:, 11:], np.arange(400) * np.pi / 200, 0.0432) for i, image in enumerate(images)]


def radiate(folder: Path) -> list[PolarScan]:
    images = map(read_image, sorted(folder.glob('radiate_tiny_foggy/Navtech_Polar/*.png')))
    return [PolarScan(i, image.T, np.arange(400) * np.pi / 200, 0.1736) for i, image in enumerate(images)]


@pytest.mark.parametrize('degrade, severities', DEGRADATIONS)
@pytest.mark.parametrize('load', [oxford, radiate])
def test_degraded_recorded_scans_are_more_uncertain(
    real_data: Path,
    load: Callable[[Path], list[PolarScan]],
    degrade: Callable[[np.ndarray, float], np.ndarray],
    severities: tuple[float, ...],
) -> None:
    scans = load(real_data)
    assert len(scans) >= 11
    encoder = RingKeyEncoder(RingKeyConfig())
    clean = [encoder.encode(scan).uncertainty for scan in scans]
    means = [float(np.mean(clean))]
    for severity in severities:
        values = [encoder.encode(with_power(scan, degrade(scan.power, severity))).uncertainty for scan in scans]
        assert all(value > before for value, before in zip(values, clean, strict=True)), severity
        means.append(float(np.mean(values)))
    assert means == sorted(means)
    assert means[-1] > max(clean) * 1.15
