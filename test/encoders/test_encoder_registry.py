from __future__ import annotations

import dataclasses
import importlib.util
import pkgutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import offradar_ros
from offradar_ros.config import EncoderConfig, RingKeyConfig
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import ENCODERS, LEARNED, EncoderEntry, make_encoder
from offradar_ros.errors import ConfigError, ModelError


@pytest.mark.parametrize('entry', ENCODERS.values(), ids=ENCODERS)
def test_the_objects_of_an_entry_exist(entry: EncoderEntry) -> None:
    assert callable(pkgutil.resolve_name(entry.factory))
    assert bool(entry.network) == bool(entry.objective)
    assert not entry.teacher or ENCODERS[entry.teacher].network
    if entry.network:
        pytest.importorskip('torch')
        from offradar_ros.encoders.networks.network import Network  # noqa: PLC0415

        assert issubclass(pkgutil.resolve_name(entry.network), Network)
        assert hasattr(pkgutil.resolve_name(entry.objective), 'losses')


def test_the_default_encoder_has_weights_in_the_package() -> None:
    assert (EncoderConfig().name, EncoderConfig().weights) == ('variational', 'compact')
    info = make_encoder(EncoderConfig()).info
    assert (info.name, info.metadata['file']) == ('variational', 'compact.onnx')


def test_the_ring_key_gets_its_settings() -> None:
    encoder = make_encoder(EncoderConfig(name='ring_key', ring_key=RingKeyConfig(rings=24)))
    assert isinstance(encoder, Encoder)
    assert (encoder.info.name, encoder.info.dimension) == ('ring_key', 24)


@pytest.mark.parametrize('backend', ['auto', 'own'])
@pytest.mark.parametrize('suffix, kind', [('.onnx', 'OnnxEncoder'), ('.safetensors', 'TorchEncoder')])
def test_the_suffix_of_the_weights_selects_the_backend(
    request: pytest.FixtureRequest, small_weights: Path, suffix: str, kind: str, backend: str
) -> None:
    if suffix == '.onnx':
        request.getfixturevalue('small_onnx')
    if backend == 'own':
        backend = {'.onnx': 'onnx', '.safetensors': 'torch'}[suffix]
    config = EncoderConfig(name='variational', weights=str(small_weights.with_suffix(suffix)), backend=backend)
    assert type(make_encoder(config)).__name__ == kind


@pytest.mark.parametrize(
    'config, expected',
    [
        (
            EncoderConfig(name='magic'),
            'encoder.name: expected one of variational, bc_radar, vae, mc_dropout, stun, ring_key, rad_vlad, got',
        ),
        (EncoderConfig(name='variational', weights=''), 'encoder.weights: expected a .onnx or .safetensors file'),
        (EncoderConfig(name='variational', weights='net.pth'), "got 'net.pth'"),
        (EncoderConfig(name='rad_vlad', weights=''), 'encoder.weights: expected a .safetensors file'),
        (
            EncoderConfig(name='rad_vlad', weights='net.onnx'),
            "encoder.weights: rad_vlad needs a .safetensors file, got 'net.onnx'",
        ),
        (
            EncoderConfig(name='variational', weights='net.onnx', backend='torch'),
            "encoder.backend: expected one of auto, onnx, opencv for net.onnx, got 'torch'",
        ),
    ],
)
def test_settings_that_do_not_match_are_refused(config: EncoderConfig, expected: str) -> None:
    with pytest.raises(ConfigError) as refused:
        make_encoder(config)
    assert str(refused.value).startswith('parameter encoder.')
    assert expected in str(refused.value)


@pytest.mark.parametrize('suffix', ['.onnx', '.safetensors'])
def test_missing_weights_are_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f'none{suffix}'
    with pytest.raises(ModelError, match='no such weights file'):
        make_encoder(EncoderConfig(name='variational', weights=str(path)))


@pytest.mark.parametrize('suffix, package', [('.onnx', 'onnxruntime'), ('.safetensors', 'torch')])
def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, suffix: str, package: str) -> None:
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: None)
    with pytest.raises(ModelError, match=f'net{suffix}: needs the Python package {package}, which is not installed'):
        make_encoder(EncoderConfig(name='variational', weights=f'net{suffix}'))


@pytest.mark.parametrize('method', [name for name in LEARNED if name != 'variational'])
def test_weights_of_another_method_are_refused(tmp_path: Path, small_config: NetworkConfig, method: str) -> None:
    pytest.importorskip('torch')
    from offradar_ros.encoders.networks.files import save_network  # noqa: PLC0415
    from offradar_ros.encoders.networks.registry import make_network  # noqa: PLC0415

    path = tmp_path / 'net.safetensors'
    save_network(path, make_network(dataclasses.replace(small_config, method=method)))
    assert make_encoder(EncoderConfig(name=method, weights=str(path))).info.name == method
    with pytest.raises(ConfigError, match=f'encoder.name: .* holds a network of {method}, got .variational.'):
        make_encoder(EncoderConfig(name='variational', weights=str(path)))


def modules_after(code: str) -> set[str]:
    """Top-level modules that a new interpreter has loaded after `code`."""
    code = textwrap.dedent(code) + '\nimport sys; print(*{name.partition(".")[0] for name in sys.modules})'
    project = Path(offradar_ros.__file__).parent.parent
    done = subprocess.run([sys.executable, '-c', code], cwd=project, capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_the_ring_key_loads_neither_runtime_nor_ros() -> None:
    loaded = modules_after("""
        from offradar_ros.config import EncoderConfig
        from offradar_ros.encoders.registry import make_encoder
        make_encoder(EncoderConfig(name='ring_key'))
    """)
    assert 'offradar_ros' in loaded
    assert not loaded & {'torch', 'rclpy', 'onnx', 'onnxruntime'}


def test_the_onnx_backend_loads_neither_torch_nor_ros(small_onnx: Path) -> None:
    loaded = modules_after(f"""
        import numpy as np
        from offradar_ros.config import EncoderConfig
        from offradar_ros.encoders.registry import make_encoder
        from offradar_ros.types import PolarScan
        encoder = make_encoder(EncoderConfig(name='variational', weights={str(small_onnx)!r}))
        power = np.full((400, 300), 50, np.uint8)
        encoder.encode(PolarScan(0, power, np.arange(400) * np.pi / 200, 0.5))
    """)
    assert {'offradar_ros', 'onnxruntime'} <= loaded
    assert not loaded & {'torch', 'rclpy', 'onnx'}


def test_modules_after_finds_a_loaded_module() -> None:
    assert 'torch' in modules_after('import offradar_ros.encoders.torch_backend')
