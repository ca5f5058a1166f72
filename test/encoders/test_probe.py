"""What a network gives for the probe image, and what counts as the same."""

from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.probe import TOLERANCE, Probe, probe_image, require_sound
from offradar_ros.errors import ConfigError, ModelError

CONFIG = NetworkConfig(backbone='compact', dimension=4, azimuths=64, range_bins=32)
MEAN = np.array([[100.0, -200.0, 0.0, 50.0]], np.float32)
VARIANCE = np.array([[0.1, 0.2, 0.3, 0.4]], np.float32)
PROBE = Probe.of(MEAN, VARIANCE)


def test_what_is_kept_is_read_again() -> None:
    assert Probe.from_text(PROBE.to_text()) == PROBE
    assert not PROBE.differs(MEAN, VARIANCE)


@pytest.mark.parametrize('text', ['', 'nonsense', '[]', '{"mean": [1.0]}', '{"mean": [1.0], "variance": "x"}'])
def test_another_text_is_refused(text: str) -> None:
    with pytest.raises(ConfigError) as refused:
        Probe.from_text(text)
    assert len(str(refused.value).splitlines()) == 1


def test_a_difference_counts_by_the_largest_value_of_mean_and_of_variance() -> None:
    for values, larger in ((MEAN, 200.0), (VARIANCE, 0.4)):
        for share, expected in ((0.9, False), (1.1, True)):
            changed = values.copy()
            changed[0, 2] += share * TOLERANCE * larger
            outputs = (changed, VARIANCE) if values is MEAN else (MEAN, changed)
            assert PROBE.differs(*outputs) == expected


def test_another_dimension_is_another_network() -> None:
    assert PROBE.differs(np.ones((1, 3), np.float32), VARIANCE)
    assert PROBE.differs(MEAN, np.ones((1, 1), np.float32))


@pytest.mark.parametrize(
    ('mean', 'variance', 'problem'),
    [
        (MEAN[:, :3], VARIANCE, r'expected outputs mean and variance of shape \(1, 4\), got \(1, 3\) and \(1, 4\)'),
        (MEAN, VARIANCE[0], r'got \(1, 4\) and \(4,\)'),
        (np.where(MEAN == 0.0, np.nan, MEAN), VARIANCE, 'not finite, or of negative variance'),
        (MEAN, np.where(VARIANCE > 0.3, np.inf, VARIANCE), 'not finite, or of negative variance'),
        (MEAN, -VARIANCE, 'not finite, or of negative variance'),
    ],
)
def test_outputs_of_no_network_are_refused(mean: np.ndarray, variance: np.ndarray, problem: str) -> None:
    require_sound((MEAN, 0.0 * VARIANCE), CONFIG, 'net.onnx')
    with pytest.raises(ModelError, match=rf'^net\.onnx: .*{problem}'):
        require_sound((mean, variance), CONFIG, 'net.onnx')


def test_the_image_has_the_shape_of_the_network_and_every_gray_level() -> None:
    assert probe_image(CONFIG).shape == (1, 64, 32)
    assert probe_image(CONFIG).dtype == np.uint8
    image = probe_image(NetworkConfig())
    assert len(np.unique(image)) == 256
