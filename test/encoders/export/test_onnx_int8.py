"""Networks in 8-bit integers against those in single precision."""

from __future__ import annotations

import dataclasses
import importlib.util
import tempfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.stats import spearmanr

pytest.importorskip('torch')
pytest.importorskip('onnx')
pytest.importorskip('onnxruntime')

import onnx
import torch

from offradar_ros.encoders.export.calibration_scans import CalibrationScans, calibration_scans
from offradar_ros.encoders.export.onnx_export import Compression, export_onnx
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.files import save_network
from offradar_ros.encoders.networks.registry import make_network
from offradar_ros.encoders.networks.stun import StunNetwork
from offradar_ros.encoders.networks.vae import VaeNetwork
from offradar_ros.encoders.networks.variational import VariationalNetwork
from offradar_ros.encoders.onnx_backend import OnnxEncoder
from offradar_ros.encoders.opencv_backend import OpencvEncoder
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.encoders.registry import LEARNED
from offradar_ros.encoders.weights import read_header
from offradar_ros.errors import ModelError
from offradar_ros.lab.simulation.city import CityPlan, make_city
from offradar_ros.lab.simulation.sensor import SimulatedSensor
from offradar_ros.lab.simulation.sequence import SimulatedSequence
from offradar_ros.lab.simulation.session_plan import SessionPlan
from offradar_ros.recordings.datasets.registry import open_sequence


def images(count: int, shape: tuple[int, int], seed: int = 9) -> np.ndarray:
    """Speckle with random brightness and coarseness in each image."""
    rng = np.random.default_rng(seed)
    fine = rng.gamma(1.5, rng.uniform(5.0, 40.0, (count, 1, 1)), (count, *shape))
    coarse = np.kron(rng.gamma(1.0, 1.0, (count, shape[0] // 8, shape[1] // 8)), np.ones((8, 8)))
    return np.minimum(fine * coarse, 255).astype(np.uint8)


def saved(config: NetworkConfig, path: Path, half: bool = False) -> Path:
    torch.manual_seed(3)
    network = make_network(config)
    if isinstance(network, (VariationalNetwork, VaeNetwork, StunNetwork)):
        torch.nn.init.normal_(network.log_variance.weight, std=0.02)
    network(torch.from_numpy(images(8, config.image_shape)))
    save_network(path, network.eval(), 'random weights of a test', half)
    return path


def small(method: str, backbone: str = 'compact') -> NetworkConfig:
    return NetworkConfig(
        method=method, backbone=backbone, dimension=8, side_px=32, azimuths=64, range_bins=32, resolution_m=2.0
    )


def error(found: np.ndarray, expected: np.ndarray) -> float:
    """Root mean square of the difference, relative to that of `expected`."""
    return float(np.sqrt(np.square(found - expected).mean() / np.square(expected).mean()))


@pytest.mark.parametrize(
    'method, backbone', [*((method, 'compact') for method in LEARNED), ('variational', 'vgg16'), ('stun', 'resnet50')]
)
def test_integers_nearly_agree_with_floats(tmp_path: Path, method: str, backbone: str) -> None:
    config = small(method, backbone)
    weights = saved(config, tmp_path / 'net.safetensors')
    export_onnx(weights, tmp_path / 'float.onnx')
    scans = CalibrationScans(images(8, config.image_shape), '8 images')
    header = export_onnx(weights, tmp_path / 'int8.onnx', Compression(scans, int8=True))
    exact, integer = OnnxEncoder(tmp_path / 'float.onnx'), OnnxEncoder(tmp_path / 'int8.onnx')
    with pytest.raises(ModelError, match='OpenCV computes 8-bit integers differently from ONNX Runtime'):
        OpencvEncoder(tmp_path / 'int8.onnx')
    assert integer.header == header
    assert header.config == config
    given = images(12, config.image_shape, seed=10)
    for found, expected in zip(integer.infer(given), exact.infer(given), strict=True):
        assert found.dtype == np.float32
        assert found.shape == (12, 8)
        assert error(found, expected) < 0.1
    for whole, single in zip(integer.infer(given), integer.infer(given[4:5]), strict=True):
        assert error(single, whole[4:5]) < 0.03


@pytest.mark.parametrize('half', [False, True])
def test_weights_are_stored_as_integers_and_the_input_stays_uint8(tmp_path: Path, half: bool) -> None:
    config = small('variational', 'vgg16')
    weights = saved(config, tmp_path / 'net.safetensors', half)
    scans = CalibrationScans(images(4, config.image_shape), '4 images')
    export_onnx(weights, tmp_path / 'float.onnx')
    export_onnx(weights, tmp_path / 'int8.onnx', Compression(scans, int8=True))
    share = (tmp_path / 'int8.onnx').stat().st_size / (tmp_path / 'float.onnx').stat().st_size
    assert share < (0.55 if half else 0.28)
    graph = onnx.load(tmp_path / 'int8.onnx').graph
    kernels = [tensor for tensor in graph.initializer if len(tensor.dims) >= 2 and np.prod(tensor.dims) > 1000]
    assert len(kernels) >= 13
    assert {tensor.data_type for tensor in kernels} == {onnx.TensorProto.INT8}
    assert graph.input[0].type.tensor_type.elem_type == onnx.TensorProto.UINT8


def test_the_fingerprint_depends_on_the_scans_and_the_export_is_deterministic(tmp_path: Path) -> None:
    config = small('variational')
    weights = saved(config, tmp_path / 'net.safetensors')
    few, more = (CalibrationScans(images(count, config.image_shape), f'{count} images') for count in (2, 6))
    parent = export_onnx(weights, tmp_path / 'float.onnx')
    headers = [
        export_onnx(weights, tmp_path / f'{name}.onnx', Compression(scans, int8=True))
        for name, scans in (('one', few), ('two', few), ('three', more))
    ]
    assert headers[0] == headers[1]
    assert (tmp_path / 'one.onnx').read_bytes() == (tmp_path / 'two.onnx').read_bytes()
    assert len({header.fingerprint for header in (parent, *headers)}) == 3
    assert parent.fingerprint in headers[0].description
    assert 'fitted to 2 images' in headers[0].description
    assert [header.stored for header in headers] == ['int8'] * 3


def test_the_fingerprint_depends_on_the_parent(tmp_path: Path) -> None:
    config = small('bc_radar')
    scans = CalibrationScans(images(2, config.image_shape), '2 images')
    found = []
    for name, changed in (('one', config), ('two', dataclasses.replace(config, min_range_m=4.0))):
        weights = saved(changed, tmp_path / f'{name}.safetensors')
        found.append(export_onnx(weights, tmp_path / f'{name}.onnx', Compression(scans, int8=True)).fingerprint)
    assert found[0] != found[1]


@pytest.mark.parametrize('share, same', [(1.0, 1.0), (0.75, 0.9)])
def test_compressed_weights_agree_with_the_originals_on_recorded_scans(
    real_data: Path, tmp_path: Path, share: float, same: float
) -> None:
    """Calibrated on simulated scans, as in docs/speed.md."""
    weights = find_weights('compact', ('.safetensors',))
    city = make_city(CityPlan(seed=2595001, blocks=(2, 2), route_m=400.0))
    fitted = SimulatedSequence(city, SessionPlan(scans=32, degraded=0.35), SimulatedSensor())
    scans = calibration_scans([fitted], read_header(weights).config)
    export_onnx(weights, tmp_path / 'copy.onnx', Compression(scans, int8=True, low_rank=share))
    drives = [open_sequence(real_data / name) for name in ('oxford_tiny', 'radiate_tiny_foggy', 'mulran_kaist03')]
    recorded = [drive.scan(index) for drive in drives for index in range(len(drive))]
    found = []
    for path in (find_weights('compact', ('.onnx',)), tmp_path / 'copy.onnx'):
        encoder = OnnxEncoder(str(path))
        embeddings = [encoder.encode(scan) for scan in recorded]
        distances = cdist(*[[embedding.mean for embedding in embeddings]] * 2)
        np.fill_diagonal(distances, np.inf)
        found.append(([embedding.uncertainty for embedding in embeddings], distances.argmin(axis=1)))
    (uncertainties, nearest), (copied_uncertainties, copied_nearest) = found
    assert len(recorded) >= 30
    assert spearmanr(uncertainties, copied_uncertainties).statistic >= 0.98
    assert np.mean(nearest == copied_nearest) >= same


def test_no_temporary_file_remains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = small('bc_radar')
    weights = saved(config, tmp_path / 'net.safetensors')
    (tmp_path / 'temporary').mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path / 'temporary'))
    scans = CalibrationScans(images(2, config.image_shape), '2 images')
    export_onnx(weights, tmp_path / 'int8.onnx', Compression(scans, int8=True))
    with pytest.raises(ModelError, match='cannot be written'):
        export_onnx(weights, tmp_path / 'absent' / 'int8.onnx', Compression(scans, int8=True))
    assert {path.name for path in tmp_path.iterdir()} == {'net.safetensors', 'int8.onnx', 'temporary'}
    assert list((tmp_path / 'temporary').iterdir()) == []


def test_a_missing_runtime_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: None if name == 'onnxruntime' else find_spec(name))
    scans = CalibrationScans(images(1, (64, 32)), 'one image')
    with pytest.raises(ModelError, match='needs the Python package onnxruntime, which is not installed'):
        export_onnx(tmp_path / 'net.safetensors', tmp_path / 'int8.onnx', Compression(scans, int8=True))
