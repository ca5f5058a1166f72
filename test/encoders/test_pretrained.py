from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders import pretrained
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.pretrained import FOLDER, find_weights, pretrained_names
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError
from offradar_ros.types import PolarScan

BOTH = ('.onnx', '.safetensors')


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(pretrained, 'FOLDER', tmp_path)
    for name in ('compact.onnx', 'compact.safetensors', 'compact.card.json', 'rad_vlad.safetensors', 'README.md'):
        (tmp_path / name).write_bytes(b'')
    return tmp_path


def test_names_are_those_of_weights_files(folder: Path) -> None:
    assert pretrained_names() == ('compact', 'rad_vlad')


@pytest.mark.parametrize(
    'weights, suffixes, expected',
    [
        ('compact', BOTH, 'compact.onnx'),
        ('compact', ('.safetensors',), 'compact.safetensors'),
        ('rad_vlad', BOTH, 'rad_vlad.safetensors'),
    ],
)
def test_a_name_gives_a_file_of_the_package(
    folder: Path, weights: str, suffixes: tuple[str, ...], expected: str
) -> None:
    assert find_weights(weights, suffixes) == folder / expected


@pytest.mark.parametrize('weights', ['compact.onnx', './compact.safetensors', '/abs/net.onnx'])
def test_a_path_is_returned_unchanged(folder: Path, weights: str) -> None:
    assert find_weights(weights, BOTH) == Path(weights)


@pytest.mark.parametrize('weights', ['', '.', '..', 'vgg16', 'sub/compact', 'compact.card', '../weights/compact', '/'])
def test_unknown_names_are_refused_with_the_known_ones(folder: Path, weights: str) -> None:
    with pytest.raises(ConfigError, match=r'of weights in offradar_ros \(compact, rad_vlad\), got') as refused:
        find_weights(weights, BOTH)
    assert str(refused.value).startswith('parameter encoder.weights: expected a .onnx or .safetensors file')


def test_a_package_without_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pretrained, 'FOLDER', tmp_path / 'absent')
    with pytest.raises(ConfigError, match='none in this build'):
        find_weights('compact', BOTH)


def test_both_files_of_a_name_are_one_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, street: PolarScan, small_config: NetworkConfig
) -> None:
    pytest.importorskip('torch')
    pytest.importorskip('onnx')
    pytest.importorskip('onnxruntime')
    from offradar_ros.encoders.export.onnx_export import export_onnx  # noqa: PLC0415
    from offradar_ros.encoders.networks.files import save_network  # noqa: PLC0415
    from offradar_ros.encoders.networks.registry import make_network  # noqa: PLC0415

    monkeypatch.setattr(pretrained, 'FOLDER', tmp_path)
    save_network(tmp_path / 'tiny.safetensors', make_network(small_config), half=True)
    export_onnx(tmp_path / 'tiny.safetensors', tmp_path / 'tiny.onnx')
    made = [make_encoder(EncoderConfig('variational', 'tiny', backend)) for backend in ('auto', 'onnx', 'torch')]
    assert [type(encoder).__name__ for encoder in made] == ['OnnxEncoder', 'OnnxEncoder', 'TorchEncoder']
    assert len({encoder.info.fingerprint for encoder in made}) == 1
    means = [encoder.encode(street).mean for encoder in made]
    np.testing.assert_allclose(means[0], means[2], rtol=0, atol=1e-4 * np.abs(means[2]).max())


def test_the_folder_of_weights_is_in_the_package() -> None:
    import offradar_ros  # noqa: PLC0415

    assert Path(offradar_ros.__file__).resolve().parent / 'weights' == FOLDER


def test_weights_are_installed_with_the_package(tmp_path: Path) -> None:
    """A wheel built from the sources holds a file of the folder."""
    import subprocess  # noqa: PLC0415
    import sys  # noqa: PLC0415
    import zipfile  # noqa: PLC0415

    project = Path(__file__).resolve().parents[2]
    sources = tmp_path / 'sources'
    shutil.copytree(
        project, sources, ignore=shutil.ignore_patterns('.git', 'bags', '__pycache__', 'test', 'weights', 'build')
    )
    (sources / 'offradar_ros' / 'weights').mkdir()
    (sources / 'offradar_ros' / 'weights' / 'tiny.onnx').write_bytes(b'weights')
    command = [sys.executable, 'setup.py', '-q', 'bdist_wheel', '-d', str(tmp_path / 'dist')]
    done = subprocess.run(command, cwd=sources, capture_output=True, text=True, check=False)
    if 'bdist_wheel' in done.stderr and done.returncode:
        pytest.skip('this setuptools builds no wheels by itself')
    assert done.returncode == 0, done.stderr
    (wheel,) = (tmp_path / 'dist').glob('*.whl')
    assert zipfile.ZipFile(wheel).read('offradar_ros/weights/tiny.onnx') == b'weights'
