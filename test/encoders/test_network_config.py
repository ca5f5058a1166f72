from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from offradar_ros.config import CartesianConfig, PolarGridConfig
from offradar_ros.encoders.network_config import BACKBONES, DESCRIPTORS, NetworkConfig
from offradar_ros.encoders.registry import LEARNED
from offradar_ros.errors import ConfigError


@given(
    st.builds(
        NetworkConfig,
        method=st.sampled_from(LEARNED),
        backbone=st.sampled_from(BACKBONES),
        dimension=st.integers(1, 4096),
        side_px=st.integers(1, 64).map(lambda n: 32 * n),
        azimuths=st.integers(1, 512).map(lambda n: 8 * n),
        range_bins=st.integers(1, 512).map(lambda n: 8 * n),
        resolution_m=st.floats(0.01, 10.0),
        min_range_m=st.floats(0.0, 50.0),
        descriptor=st.sampled_from(DESCRIPTORS),
        dropout=st.floats(0.01, 0.99),
        student=st.sampled_from(['bounded', 'free']),
    )
)
def test_json_round_trip(config: NetworkConfig) -> None:
    assert NetworkConfig.from_json(config.to_json()) == config


def test_default_is_the_papers_network() -> None:
    config = NetworkConfig()
    assert config.method == 'variational'
    assert (config.backbone, config.dimension, config.descriptor) == ('vgg16', 128, 'z_i_plus_mu')
    assert config.image == CartesianConfig(side_px=256, resolution_m=0.5, min_range_m=2.5)
    assert config.image_shape == (256, 256)
    assert config.reach_m == pytest.approx(math.hypot(64, 64))


def test_the_compact_network_sees_a_polar_image() -> None:
    config = NetworkConfig(backbone='compact', azimuths=64, range_bins=32, resolution_m=2.0, min_range_m=3.0)
    assert config.image == PolarGridConfig(azimuths=64, range_bins=32, resolution_m=2.0, min_range_m=3.0)
    assert config.image_shape == (64, 32)
    assert config.reach_m == 64.0


@pytest.mark.parametrize(
    'name, value',
    [
        ('method', 'magic'),
        ('backbone', 'resnet'),
        ('descriptor', 'z'),
        ('dimension', 0),
        ('side_px', 100),
        ('side_px', 0),
        ('side_px', 4128),
        ('azimuths', 100),
        ('azimuths', 0),
        ('range_bins', 12),
        ('range_bins', 4104),
        ('resolution_m', 0.0),
        ('resolution_m', float('nan')),
        ('min_range_m', -1.0),
        ('dropout', 0.0),
        ('dropout', 1.0),
        ('student', 'none'),
    ],
)
def test_invalid_values_are_refused(name: str, value: Any) -> None:
    with pytest.raises(ConfigError, match=f'network setting {name}: expected .* got {value!r}'):
        NetworkConfig(**{name: value})


@pytest.mark.parametrize(
    'change', [{'dimension': 128.0}, {'dimension': True}, {'side_px': '256'}, {'resolution_m': None}, {'more': 1}]
)
def test_values_of_another_type_are_refused(change: dict[str, Any]) -> None:
    text = json.dumps({**json.loads(NetworkConfig().to_json()), **change})
    with pytest.raises(ConfigError, match='network setting'):
        NetworkConfig.from_json(text)


@given(st.text(max_size=40) | st.dictionaries(st.text(max_size=9), st.integers(), max_size=3).map(json.dumps))
def test_any_other_text_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ConfigError) as refused:
        NetworkConfig.from_json(text)
    assert '\n' not in str(refused.value)
