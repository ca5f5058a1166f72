"""Navtech's messages: here objects with the same fields, as the package need not be installed."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.ros import navtech

FIRST_NS = 11_750_000_000


def configuration(**changes: Any) -> SimpleNamespace:
    fields = {
        'azimuth_samples': 400,
        'encoder_size': 5600,
        'bin_size': 438.0,
        'range_in_bins': 100,
        'range_gain': 1.0,
        'range_offset': -0.31,
    }
    return SimpleNamespace(**(fields | changes))  # fmt: skip


def b_scan(rows: int = 400, encoders: list[int] | None = None) -> SimpleNamespace:
    power = np.random.default_rng(0).integers(1, 200, (rows, 100), np.uint8)
    image = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=12, nanosec=34), frame_id='b_scan_extended'),
        height=rows, width=100, step=100, encoding='8UC1', data=power.tobytes(),
    )  # fmt: skip
    angles = [(7 + 14 * row) % 5600 for row in range(rows)] if encoders is None else encoders
    return SimpleNamespace(
        b_scan_img=image, encoder_values=angles, timestamps=[FIRST_NS + 625_000 * row for row in range(rows)]
    )


def test_bin_size_is_in_tenths_of_a_millimetre() -> None:
    config = navtech.configured(RadarConfig(), configuration())
    assert config.range_resolution_m == pytest.approx(0.0438)
    assert config.range_offset_m == -0.31


def test_explicit_parameters_take_precedence_over_the_sensor() -> None:
    config = navtech.configured(RadarConfig(range_resolution_m=0.0432), configuration())
    assert config.range_resolution_m == 0.0432


@pytest.mark.parametrize('changes', [{'bin_size': 0.0}, {'azimuth_samples': 0}, {'encoder_size': 0}])
def test_a_configuration_of_zeros_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(RefusedInput, match='expected all above zero'):
        navtech.configured(RadarConfig(), configuration(**changes))


def test_rows_lie_at_their_encoder_angles() -> None:
    scan = navtech.scan_from_b_scan(b_scan(), navtech.configured(RadarConfig(), configuration()))
    np.testing.assert_allclose(scan.azimuths_rad, (7 + 14 * np.arange(400)) / 5600 * 2 * np.pi)
    assert scan.stamp_ns == 12_000_000_034
    assert scan.range_resolution_m == pytest.approx(0.0438)
    np.testing.assert_array_equal(scan.azimuth_stamps_ns, FIRST_NS + 625_000 * np.arange(400))


def test_rows_turn_in_the_configured_direction() -> None:
    config = navtech.configured(RadarConfig(azimuth_direction='counterclockwise'), configuration())
    scan = navtech.scan_from_b_scan(b_scan(), config)
    np.testing.assert_allclose(scan.azimuths_rad, 2 * np.pi - (7 + 14 * np.arange(400)) / 5600 * 2 * np.pi)


def test_a_scan_with_too_few_angles_is_refused() -> None:
    with pytest.raises(RefusedInput, match='400 rows but 3 encoder values'):
        navtech.scan_from_b_scan(b_scan(encoders=[1, 2, 3]), navtech.configured(RadarConfig(), configuration()))


def test_without_the_package_there_is_nothing_to_subscribe_to() -> None:
    assert navtech.message_types() is None


def test_the_package_is_found_when_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    messages = ModuleType('navtech_msgs.msg')
    messages.RadarBScanMsg, messages.RadarConfigurationMsg = int, float  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, 'navtech_msgs', ModuleType('navtech_msgs'))
    monkeypatch.setitem(sys.modules, 'navtech_msgs.msg', messages)
    assert navtech.message_types() == (int, float)


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('range_offset', float('nan')),
        ('range_offset', float('-inf')),
        ('range_offset', 1e30),
        ('range_gain', float('nan')),
        ('bin_size', float('inf')),
        ('azimuth_samples', 65535),
        ('encoder_size', 1),
    ],
)
def test_settings_that_would_spoil_every_later_scan_are_refused(name: str, value: float) -> None:
    with pytest.raises(RefusedInput, match='radar configuration') as refused:
        navtech.configured(RadarConfig(), configuration(**{name: value}))
    assert refused.value.cause == 'wrong_configuration'


def test_row_stamps_beyond_63_bits_are_left_out() -> None:
    config = navtech.configured(RadarConfig(), configuration())
    message = b_scan()
    message.timestamps = [2**64 - 1] * 400
    assert navtech.scan_from_b_scan(message, config).azimuth_stamps_ns is None
