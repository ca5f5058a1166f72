from __future__ import annotations

import pytest

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.radar.profiles import PROFILES, range_resolution


@pytest.mark.parametrize(('bins', 'metres'), [(3768, 0.0432), (3360, 0.0595238), (576, 0.1736), (6848, 0.0438)])
def test_recorded_formats_are_recognised_by_their_bins(bins: int, metres: float) -> None:
    assert range_resolution(RadarConfig(), bins) == metres


def test_a_named_profile_applies_to_any_number_of_bins() -> None:
    assert range_resolution(RadarConfig(profile='cir204h'), 1000) == 0.0595238


def test_an_explicit_resolution_has_priority() -> None:
    assert range_resolution(RadarConfig(profile='cir204h', range_resolution_m=0.05), 3768) == 0.05


@pytest.mark.parametrize('profile', ['auto', 'custom'])
def test_an_unknown_number_of_bins_names_the_parameter(profile: str) -> None:
    with pytest.raises(RefusedInput, match=r'radar\.range_resolution_m') as refused:
        range_resolution(RadarConfig(profile=profile), 2856)
    assert refused.value.cause == 'unknown_range_resolution'


def test_maximum_ranges_of_the_profiles_are_those_of_the_sensors() -> None:
    reach = {name: p.range_bins * p.range_resolution_m for name, p in PROFILES.items()}
    assert reach == pytest.approx(
        {'cts350x': 162.8, 'cir204h': 200.0, 'radiate': 100.0, 'navtech_300m': 300.0}, abs=0.1
    )
