"""Embeddings on disk: encoded once, read as they were written, and complete or absent."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import DataError, RefusedInput
from offradar_ros.lab.evaluation import embedding_cache
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive, cached_embeddings, encode_drive
from offradar_ros.lab.evaluation.methods import open_method
from offradar_ros.types import Embedding, PolarScan


def quiet(done: int, total: int) -> None:
    del done, total


class NumberEncoder:
    """Encodes scan n as the number n; refuses scan 1, gives NaN for scan 2, and counts calls."""

    runs_on = 'cpu'

    def __init__(self) -> None:
        self.calls = 0

    @property
    def info(self) -> ModelInfo:
        return ModelInfo('number', 'f' * 64, 3, {})

    def encode(self, scan: PolarScan) -> Embedding:
        self.calls += 1
        number = scan.stamp_ns // 10**9
        if number == 1:
            raise RefusedInput('no_signal', 'nothing there')
        value = np.nan if number == 2 else number
        return Embedding(scan.stamp_ns, np.full(3, value, np.float32), np.full(3, 0.5, np.float32))


def test_embeddings_are_encoded_once(embedded_street: Callable[..., EmbeddedDrive], tmp_path: Path) -> None:
    drive, encoder = embedded_street(0, 6).drive, NumberEncoder()
    first = cached_embeddings(encoder, drive, tmp_path, quiet)
    assert first.usable.tolist() == [True, False, False, True, True, True]
    assert first.means[3].tolist() == [3.0, 3.0, 3.0]
    second = cached_embeddings(encoder, drive, tmp_path, quiet)
    assert encoder.calls == 6
    np.testing.assert_array_equal(first.means, second.means)
    np.testing.assert_array_equal(first.uncertainties, second.uncertainties)
    next(tmp_path.rglob('*.means.npy')).write_bytes(b'')
    with pytest.raises(DataError, match='damaged embeddings'):
        cached_embeddings(encoder, drive, tmp_path, quiet)


def test_batches_have_the_embeddings_of_single_scans(
    embedded_street: Callable[..., EmbeddedDrive], tmp_path: Path
) -> None:
    torch = pytest.importorskip('torch')
    network_files = pytest.importorskip('offradar_ros.encoders.networks.files')
    from offradar_ros.encoders.network_config import NetworkConfig  # noqa: PLC0415
    from offradar_ros.encoders.networks.registry import make_network  # noqa: PLC0415

    torch.manual_seed(1)
    network = make_network(NetworkConfig(backbone='compact', side_px=32, resolution_m=4.0))
    network_files.save_network(tmp_path / 'best.safetensors', network)
    # The folder of a training run, as a variant.
    method = open_method(f'variant=ours:{tmp_path}', tmp_path, seed=0, spacing_m=5.0, threads=1)
    assert (method.name, Path(method.weights).name) == ('variant', 'best.safetensors')
    drive = embedded_street(0, 20).drive
    encoder = method.encoder_for(drive)
    made = encode_drive(encoder, drive, quiet)
    for row in (0, 15, 16, 19):
        alone = encoder.encode(drive.scan(row))
        np.testing.assert_allclose(made.means[row], alone.mean, rtol=1e-3, atol=1e-5)
        assert made.uncertainties[row] == pytest.approx(alone.uncertainty, rel=1e-3)


def test_an_interrupted_drive_continues_at_the_last_block(
    embedded_street: Callable[..., EmbeddedDrive], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(embedding_cache, 'BLOCK', 10)
    drive, encoder = embedded_street(0, 35).drive, NumberEncoder()

    def interrupt(done: int, total: int) -> None:
        assert total == 35
        if done > 24:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cached_embeddings(encoder, drive, tmp_path, interrupt)
    before = encoder.calls
    assert before <= 30
    made = cached_embeddings(encoder, drive, tmp_path, quiet)
    # The first two blocks were kept.
    assert encoder.calls - before == 15
    whole = encode_drive(NumberEncoder(), drive, quiet)
    np.testing.assert_array_equal(made.means, whole.means)
    np.testing.assert_array_equal(made.uncertainties, whole.uncertainties)
    assert len(list(tmp_path.rglob('*.npy'))) == 2
