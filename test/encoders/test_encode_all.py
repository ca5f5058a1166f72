from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.encode import encode_all
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import RefusedInput
from offradar_ros.types import PolarScan


class Drive:
    """Scans of noise: one without power, and one that its source refuses."""

    name, layout, trajectory = 'drive', 'test', None
    stamps_ns = np.arange(21, dtype=np.int64)
    silent, refused = 4, 19

    def __len__(self) -> int:
        return 21

    def scan(self, index: int) -> PolarScan:
        if index == self.refused:
            raise RefusedInput('no_signal', 'nothing there')
        power = np.random.default_rng(index).integers(0, 200, (400, 200)).astype(np.uint8)
        return PolarScan(index, power * (index != self.silent), np.arange(400) * np.pi / 200, 0.5)


def encoder_of(kind: str, request: pytest.FixtureRequest) -> Encoder:
    if kind == 'ring_key':
        return make_encoder(EncoderConfig(name='ring_key'))
    weights: Path = request.getfixturevalue('small_onnx' if kind == 'onnx' else 'small_weights')
    return make_encoder(EncoderConfig(name='variational', weights=str(weights)))


@pytest.mark.parametrize('kind', ['ring_key', 'onnx', 'torch'])
def test_encode_all_equals_encode_of_each_scan(request: pytest.FixtureRequest, kind: str) -> None:
    encoder, drive = encoder_of(kind, request), Drive()
    reported: list[tuple[int, int]] = []
    means, variances = encode_all(encoder, drive, lambda done, total: reported.append((done, total)))
    assert means.shape == variances.shape == (21, encoder.info.dimension)
    assert means.dtype == variances.dtype == np.float32
    assert reported[-1] == (21, 21)
    for index in range(21):
        if index in (drive.silent, drive.refused):
            assert np.isnan(means[index]).all()
            assert np.isnan(variances[index]).all()
            continue
        embedding = encoder.encode(drive.scan(index))
        np.testing.assert_allclose(means[index], embedding.mean, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(variances[index], embedding.variance, rtol=1e-4, atol=1e-5)
