"""The runtimes of the learned encoder against each other."""

from __future__ import annotations

import dataclasses
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from radar_images import read_image, speckle

pytest.importorskip('torch')
pytest.importorskip('onnx')
pytest.importorskip('onnxruntime')

import onnx
import torch

from offradar_ros.encoders.export.onnx_export import export_onnx
from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.files import load_network, save_network
from offradar_ros.encoders.networks.variational import VariationalNetwork
from offradar_ros.encoders.onnx_backend import OnnxEncoder
from offradar_ros.encoders.onnx_digest import with_digest
from offradar_ros.encoders.opencv_backend import OpencvEncoder
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.torch_backend import TorchEncoder
from offradar_ros.encoders.weights import read_header
from offradar_ros.errors import ModelError, RefusedInput
from offradar_ros.types import PolarScan

AGREEMENT = 1e-4


@pytest.fixture(params=['onnx', 'opencv', 'torch'])
def encoder(request: pytest.FixtureRequest, small_weights: Path, small_onnx: Path) -> ImageEncoder:
    if request.param == 'torch':
        return TorchEncoder(small_weights)
    return OnnxEncoder(small_onnx) if request.param == 'onnx' else OpencvEncoder(small_onnx)


def assert_agree(one: np.ndarray, two: np.ndarray) -> None:
    assert one.shape == two.shape
    assert one.dtype == two.dtype == np.float32
    assert np.abs(one - two).max() <= AGREEMENT * np.abs(two).max()


def test_backends_agree_on_a_scan(small_weights: Path, small_onnx: Path, street: PolarScan) -> None:
    two = TorchEncoder(small_weights)
    for one in (OnnxEncoder(small_onnx), OpencvEncoder(small_onnx)):
        assert one.info.fingerprint == two.info.fingerprint == read_header(small_weights).fingerprint
        assert_agree(one.encode(street).mean, two.encode(street).mean)
        assert_agree(one.encode(street).variance, two.encode(street).variance)


@pytest.mark.parametrize('backbone, descriptor', [('compact', 'z_i'), ('vgg16', 'z_i_plus_mu'), ('resnet50', 'z_i')])
def test_backends_agree_at_full_size(
    save_random: Callable[[NetworkConfig], Path], backbone: str, descriptor: str
) -> None:
    config = NetworkConfig(backbone=backbone, descriptor=descriptor)
    weights = save_random(config)
    exported = weights.with_suffix('.onnx')
    header = export_onnx(weights, exported)
    two = TorchEncoder(weights)
    images = speckle(2, config.image_shape)
    for one in (OnnxEncoder(exported), OpencvEncoder(exported)):
        assert one.header == two.header == header
        for found, expected in zip(one.infer(images), two.infer(images), strict=True):
            assert_agree(found, expected)
            assert found.std(axis=1).min() > 1e-3  # outputs are not constant
    exported.unlink()
    weights.unlink()


def test_backends_agree_on_recorded_scans(real_data: Path, small_weights: Path, small_onnx: Path) -> None:
    one, two = OnnxEncoder(small_onnx), TorchEncoder(small_weights)
    for path in sorted(real_data.glob('oxford_tiny/radar/*.png'))[:3]:
        scan = PolarScan(0, read_image(path)[:, 11:], np.arange(400) * np.pi / 200, 0.0432)
        assert_agree(one.encode(scan).mean, two.encode(scan).mean)
        assert_agree(one.encode(scan).variance, two.encode(scan).variance)


def test_opencv_agrees_with_onnx_runtime_on_the_weights_of_the_package() -> None:
    path = find_weights('compact', ('.onnx',))
    one, two = OpencvEncoder(path), OnnxEncoder(path)
    assert one.info == two.info
    images = speckle(3, one.header.config.image_shape)
    for found, expected in zip(one.infer(images), two.infer(images), strict=True):
        assert_agree(found, expected)
    assert OpencvEncoder(path, threads=1).runs_on == 'cpu'


def test_is_an_encoder(encoder: ImageEncoder, street: PolarScan) -> None:
    embedding = encoder.encode(street)
    assert isinstance(encoder, Encoder)
    assert encoder.info.name == 'variational'
    assert encoder.info.metadata['description'] == 'random weights of a test'
    assert embedding.mean.shape == embedding.variance.shape == (encoder.info.dimension,) == (8,)
    assert embedding.stamp_ns == street.stamp_ns
    assert embedding.model == encoder.info.fingerprint
    assert embedding.uncertainty > 0
    np.testing.assert_array_equal(embedding.mean, encoder.encode(street).mean)


def test_batches_and_single_images_agree(encoder: ImageEncoder) -> None:
    images = speckle(5, encoder.header.config.image_shape)
    together = encoder.infer(images)
    for i in range(5):
        for whole, single in zip(together, encoder.infer(images[i : i + 1]), strict=True):
            np.testing.assert_allclose(whole[i], single[0], rtol=1e-4, atol=1e-6)


def test_threads_do_not_change_the_embedding(small_onnx: Path, street: PolarScan) -> None:
    one, two = OnnxEncoder(small_onnx, threads=1).encode(street), OnnxEncoder(small_onnx).encode(street)
    np.testing.assert_allclose(one.mean, two.mean, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize('cores', [1, len(os.sched_getaffinity(0))])
def test_threads_run_on_any_core_of_the_process_and_on_no_other(small_onnx: Path, cores: int) -> None:
    program = f"""
import os
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:{cores}])
from offradar_ros.encoders.onnx_backend import OnnxEncoder
from offradar_ros.encoders.onnx_digest import with_digest
encoder = OnnxEncoder({str(small_onnx)!r})
print({{frozenset(os.sched_getaffinity(int(thread))) for thread in os.listdir('/proc/self/task')}})
"""
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == str({frozenset(sorted(os.sched_getaffinity(0))[:cores])})


@pytest.mark.parametrize('shape', [(0, 0), (0, 300), (400, 0), (400, 300)])
def test_scans_without_signal_are_refused(encoder: ImageEncoder, shape: tuple[int, int]) -> None:
    scan = PolarScan(5, np.zeros(shape, np.uint8), np.arange(shape[0]) * 2 * np.pi / max(1, shape[0]), 0.5)
    with pytest.raises(RefusedInput, match='scan at 5 ns') as refused:
        encoder.encode(scan)
    assert refused.value.cause == 'no_signal'


def test_signal_outside_the_image_is_no_signal(encoder: ImageEncoder, street: PolarScan) -> None:
    power = np.zeros_like(street.power)
    power[:, :2] = power[:, 257:] = 200
    with pytest.raises(RefusedInput, match='no power within the image of the network'):
        encoder.encode(dataclasses.replace(street, power=power))


class _NotFinite(OnnxEncoder):
    """Gives numbers for the probe image, and none after it."""

    value = 1.0

    def infer(self, images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean, variance = super().infer(images)
        return mean * np.float32(self.value), variance


@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_values_that_are_not_finite_are_returned(small_onnx: Path, street: PolarScan, value: float) -> None:
    encoder = _NotFinite(small_onnx)
    encoder.value = value
    assert not np.isfinite(encoder.encode(street).mean).any()


@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_a_network_whose_outputs_are_not_finite_is_refused_when_it_is_loaded_or_exported(
    tmp_path: Path, small_weights: Path, value: float
) -> None:
    network, _ = load_network(small_weights)
    assert isinstance(network, VariationalNetwork)
    with torch.no_grad():
        network.z_i.bias[3] = value
    weights = tmp_path / 'odd.safetensors'
    save_network(weights, network)
    expected = r'odd\.safetensors: its outputs for a probe image are not finite'
    with pytest.raises(ModelError, match=expected):
        TorchEncoder(weights)
    with pytest.raises(ModelError, match=expected):
        export_onnx(weights, tmp_path / 'odd.onnx')
    assert not (tmp_path / 'odd.onnx').exists()


def test_export_writes_the_header_and_no_other_file(small_weights: Path, small_onnx: Path) -> None:
    model = onnx.load(small_onnx)
    onnx.checker.check_model(model, full_check=True)
    found = {prop.key: prop.value for prop in model.metadata_props}
    own = {'offradar.probe', 'offradar.digest'}
    assert {key: text for key, text in found.items() if key not in own} == read_header(small_weights).to_metadata()
    assert found.keys() > own
    assert {path.name for path in small_onnx.parent.iterdir()} == {small_weights.name, small_onnx.name}


def test_export_of_missing_weights_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r'none\.safetensors: no such weights file'):
        export_onnx(tmp_path / 'none.safetensors', tmp_path / 'out.onnx')
    assert not list(tmp_path.iterdir())


def test_export_to_a_missing_folder_is_refused(tmp_path: Path, small_weights: Path) -> None:
    with pytest.raises(ModelError, match=r'out\.onnx: cannot be written'):
        export_onnx(small_weights, tmp_path / 'absent' / 'out.onnx')


@pytest.mark.parametrize('make', [OnnxEncoder, OpencvEncoder])
@pytest.mark.parametrize('share', [0.0, 0.3, 0.999])
def test_truncated_onnx_is_refused_in_one_line(
    tmp_path: Path, small_onnx: Path, share: float, make: Callable[[Path], ImageEncoder]
) -> None:
    path, content = tmp_path / 'cut.onnx', small_onnx.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ModelError, match=r'cut\.onnx: ') as refused:
        make(path)
    assert '\n' not in str(refused.value)


@pytest.mark.parametrize('make', [OnnxEncoder, OpencvEncoder])
def test_foreign_onnx_is_refused(tmp_path: Path, small_onnx: Path, make: Callable[[Path], ImageEncoder]) -> None:
    model = onnx.load(small_onnx)
    del model.metadata_props[:]
    path = tmp_path / 'foreign.onnx'
    onnx.save(model, path)
    with pytest.raises(ModelError, match=r'foreign\.onnx: not offradar weights: .* no offradar\.settings'):
        make(path)


def saved(model: onnx.ModelProto, path: Path) -> Path:
    """The model as a file with a digest that is right."""
    digest = next(entry for entry in model.metadata_props if entry.key == 'offradar.digest')
    model.metadata_props.remove(digest)
    path.write_bytes(with_digest(model.SerializeToString()))
    return path


def test_onnx_with_a_graph_that_does_not_match_its_metadata_is_refused(
    tmp_path: Path, small_onnx: Path, small_config: NetworkConfig
) -> None:
    model = onnx.load(small_onnx)
    for prop in model.metadata_props:
        if prop.key == 'offradar.settings':
            prop.value = dataclasses.replace(small_config, dimension=16).to_json()
    path = saved(model, tmp_path / 'swapped.onnx')
    for make in (OnnxEncoder, OpencvEncoder):
        with pytest.raises(ModelError, match=r'swapped\.onnx: expected (inputs and )?outputs'):
            make(path)


@pytest.mark.parametrize('make', [OnnxEncoder, OpencvEncoder])
def test_a_runtime_that_computes_something_else_is_refused(
    tmp_path: Path, small_onnx: Path, make: Callable[[Path], ImageEncoder]
) -> None:
    # As if the runtime did not read a tensor as the exporter wrote it: the file itself is in order.
    model = onnx.load(small_onnx)
    kernel = next(tensor for tensor in model.graph.initializer if len(tensor.dims) == 4)
    kernel.CopyFrom(onnx.numpy_helper.from_array(-onnx.numpy_helper.to_array(kernel), kernel.name))
    path = saved(model, tmp_path / 'other.onnx')
    with pytest.raises(ModelError, match=r'other\.onnx: \w+ computes another embedding of a probe image'):
        make(path)


def test_a_network_that_fails_when_it_runs_is_refused_in_one_line(tmp_path: Path, small_onnx: Path) -> None:
    # The number of images is known only then.
    model = onnx.load(small_onnx)
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.array([7, -1]), 'shape'))
    for name in ('mean', 'variance'):
        last = next(node for node in model.graph.node if name in node.output)
        last.output[:] = [f'{name}_of_all']
        model.graph.node.append(onnx.helper.make_node('Reshape', [f'{name}_of_all', 'shape'], [f'{name}_of_7']))
        model.graph.node.append(onnx.helper.make_node('Reshape', [f'{name}_of_7', 'all'], [name]))
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.array([-1, 8]), 'all'))
    path = saved(model, tmp_path / 'fails.onnx')
    with pytest.raises(ModelError, match=r'fails\.onnx: ONNX Runtime cannot run it') as refused:
        OnnxEncoder(path)
    assert '\n' not in str(refused.value)


def test_half_precision_of_an_odd_length_is_refused_by_opencv(tmp_path: Path, small_onnx: Path) -> None:
    model = onnx.load(small_onnx)
    model.graph.initializer.append(
        onnx.TensorProto(name='odd', data_type=onnx.TensorProto.FLOAT16, dims=[3], raw_data=b'12345')
    )
    with pytest.raises(ModelError, match=r'odd\.onnx: OpenCV [0-9.]+ cannot run it'):
        OpencvEncoder(saved(model, tmp_path / 'odd.onnx'))


@pytest.mark.parametrize('make', [OnnxEncoder, OpencvEncoder])
def test_onnx_that_refers_to_another_file_is_refused(
    tmp_path: Path, small_onnx: Path, make: Callable[[Path], ImageEncoder], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = onnx.load(small_onnx)
    kernel = next(tensor for tensor in model.graph.initializer if len(tensor.dims) == 4)
    (tmp_path / 'kernel').write_bytes(kernel.raw_data)
    kernel.ClearField('raw_data')
    kernel.data_location = onnx.TensorProto.EXTERNAL
    kernel.external_data.add(key='location', value='kernel')
    path = saved(model, tmp_path / 'outside.onnx')
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelError, match=r'outside\.onnx: refers to tensors in other files'):
        make(path)


@pytest.mark.parametrize('make', [OnnxEncoder, OpencvEncoder, TorchEncoder])
def test_missing_file_is_named(tmp_path: Path, make: Callable[[Path], ImageEncoder]) -> None:
    with pytest.raises(ModelError, match='absent: no such weights file'):
        make(tmp_path / 'absent')


def test_an_operator_that_opencv_does_not_support_is_reported(tmp_path: Path, small_onnx: Path) -> None:
    model = onnx.load(small_onnx)
    model.graph.node[-1].op_type = 'NobodyHasIt'
    saved(model, tmp_path / 'odd.onnx')
    expected = r'odd\.onnx: OpenCV [0-9.]+ cannot run it: pip install onnxruntime'
    with pytest.raises(ModelError, match=expected) as refused:
        OpencvEncoder(tmp_path / 'odd.onnx')
    assert '\n' not in str(refused.value)


def test_a_file_whose_name_is_not_text_gives_a_model_that_is(small_weights: Path, tmp_path: Path) -> None:
    odd = Path(shutil.copy(small_weights, tmp_path / os.fsdecode(b'\xff.safetensors')))
    assert TorchEncoder(odd).info.metadata['file'] == '?.safetensors'
