from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip('torch')
onnx = pytest.importorskip('onnx')
pytest.importorskip('onnxruntime')

from offradar_ros.config import EncoderConfig  # noqa: E402
from offradar_ros.encoders.network_config import NetworkConfig  # noqa: E402
from offradar_ros.encoders.networks.files import save_network  # noqa: E402
from offradar_ros.encoders.networks.variational import VariationalNetwork  # noqa: E402
from offradar_ros.encoders.registry import make_encoder  # noqa: E402
from offradar_ros.encoders.weights import read_header  # noqa: E402
from offradar_ros.errors import ModelError  # noqa: E402
from offradar_ros.recordings.bags.sequence import BagSequence  # noqa: E402


@pytest.fixture(scope='module')
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(5)
    path = tmp_path_factory.mktemp('weights') / 'compact.safetensors'
    config = NetworkConfig(backbone='compact', dimension=8, azimuths=64, range_bins=32, resolution_m=2.0)
    save_network(path, VariationalNetwork(config), 'random weights of a test')
    return path


def test_the_exported_network_is_the_same_model(
    done: Callable[..., str], weights: Path, street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    exported = tmp_path / 'compact.onnx'
    before = make_encoder(EncoderConfig(name='variational', weights=str(weights)))
    assert done('export', weights, exported) == f'{exported}: {before.info.fingerprint}\n'
    after = make_encoder(EncoderConfig(name='variational', weights=str(exported)))
    assert after.info.fingerprint == before.info.fingerprint
    scan = BagSequence(street_bag('bag', count=1)).scan(0)
    np.testing.assert_allclose(after.encode(scan).mean, before.encode(scan).mean, atol=1e-4)
    np.testing.assert_allclose(after.encode(scan).variance, before.encode(scan).variance, atol=1e-4)


def test_the_exported_network_drives(
    done: Callable[..., str], weights: Path, street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    done('export', weights, tmp_path / 'compact.onnx')
    params, calibrated = tmp_path / 'params.yaml', tmp_path / 'calibrated.yaml'
    params.write_text(f'encoder: {{name: variational, weights: {tmp_path / "compact.onnx"}}}\n')
    bag = street_bag('bag', count=4)
    done('calibrate', bag, '--out', calibrated, '--params', params)
    options = ['--params', calibrated, '--map', tmp_path / 'map.db']
    assert 'rejected: map_empty' in done('drive', bag, *options, '--session', 'one')
    assert 'match' in done('drive', bag, *options)
    assert 'model: variational, d = 8' in done('map', tmp_path / 'map.db')


def test_onnx_of_an_earlier_version_gets_a_digest(
    done: Callable[..., str],
    refused: Callable[..., str],
    weights: Path,
    street_bag: Callable[..., Path],
    tmp_path: Path,
) -> None:
    new, old, out = tmp_path / 'new.onnx', tmp_path / 'old.onnx', tmp_path / 'out.onnx'
    done('export', weights, new)
    assert 'has a digest already' in refused('export', new, out)
    model = onnx.load(new)
    del model.metadata_props[-2:]
    onnx.save(model, old)
    scan = BagSequence(street_bag('bag', count=1)).scan(0)
    with pytest.raises(ModelError, match='has no digest'):
        make_encoder(EncoderConfig(name='variational', weights=str(old)))
    assert 'options are for .safetensors' in refused('export', old, out, '--half')
    assert not out.exists()
    assert 'now with a digest of what' in done('export', old, out)
    before, after = (make_encoder(EncoderConfig(name='variational', weights=str(path))) for path in (new, out))
    assert before.info.fingerprint == after.info.fingerprint
    np.testing.assert_array_equal(before.encode(scan).mean, after.encode(scan).mean)


def test_bad_weights_are_refused(refused: Callable[..., str], weights: Path, tmp_path: Path) -> None:
    out = tmp_path / 'out.onnx'
    cut = tmp_path / 'cut.safetensors'
    cut.write_bytes(weights.read_bytes()[:2000])
    assert 'no such weights file' in refused('export', tmp_path / 'nothing.safetensors', out)
    assert f'{cut}: not a readable safetensors file' in refused('export', cut, out)
    altered = bytearray(weights.read_bytes())
    altered[-5] ^= 0x40
    cut.write_bytes(altered)
    assert f'{cut}: damaged or altered' in refused('export', cut, out)
    assert not out.exists()


def test_a_place_that_cannot_be_written_is_refused(refused: Callable[..., str], weights: Path, tmp_path: Path) -> None:
    assert 'cannot be written' in refused('export', weights, tmp_path / 'no' / 'out.onnx')
    for folder in (tmp_path, '', '.'):
        assert 'a folder is there' in refused('export', weights, folder)
    assert list(tmp_path.iterdir()) == []


def test_weights_are_halved_and_their_uncertainty_set_to_1_over_a_drive(
    done: Callable[..., str], weights: Path, street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag = street_bag('bag', count=6)
    shipped, onnx = tmp_path / 'shipped.safetensors', tmp_path / 'shipped.onnx'
    done('export', weights, shipped, '--half', '--unit-u', bag)
    done('export', shipped, onnx)
    assert shipped.stat().st_size < 0.6 * weights.stat().st_size
    drive = BagSequence(bag)
    for path in (shipped, onnx):
        encoder = make_encoder(EncoderConfig(name='variational', weights=str(path)))
        uncertainties = [encoder.encode(drive.scan(index)).uncertainty for index in range(6)]
        assert np.mean(uncertainties) == pytest.approx(1.0, abs=5e-3)


def test_onnx_is_exported_as_the_weights_are(
    refused: Callable[..., str], weights: Path, street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    for options in (['--half'], ['--unit-u', street_bag('bag', count=1)]):
        assert '--half and --unit-u are for .safetensors' in refused('export', weights, tmp_path / 'out.onnx', *options)
    assert not (tmp_path / 'out.onnx').exists()


def test_a_network_in_integers_is_another_model_that_drives(
    done: Callable[..., str], weights: Path, street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    one, two = street_bag('one', count=3), street_bag('two', count=3)
    drives = ['--calibrate', one, '--calibrate', two]
    made = {name: tmp_path / f'{name}.onnx' for name in ('int8', 'again', 'fewer', 'low_rank', 'both')}
    printed = done('export', weights, made['int8'], '--int8', *drives)
    done('export', weights, made['again'], '--int8', *drives)
    done('export', weights, made['fewer'], '--int8', *drives, '--scans', 2)
    done('export', weights, made['low_rank'], '--low-rank', 0.5, *drives)
    done('export', weights, made['both'], '--low-rank', 0.5, '--int8', *drives)
    assert made['int8'].read_bytes() == made['again'].read_bytes()
    assert {path.name for path in tmp_path.glob('*.onnx')} == {path.name for path in made.values()}
    infos = {n: make_encoder(EncoderConfig(name='variational', weights=str(p))).info for n, p in made.items()}
    parent = make_encoder(EncoderConfig(name='variational', weights=str(weights))).info.fingerprint
    assert printed == f'{made["int8"]}: {infos["int8"].fingerprint}\n'
    assert len({parent, *(infos[name].fingerprint for name in ('int8', 'fewer', 'low_rank', 'both'))}) == 5
    assert infos['int8'].metadata['description'] == (
        f'random weights of a test; int8 of {parent}, fitted to 6 scans of one, two'
    )
    assert 'fitted to 2 scans of one, two' in infos['fewer'].metadata['description']
    assert [infos[name].metadata['stored'] for name in ('int8', 'low_rank', 'both')] == ['int8', 'float32', 'int8']
    params, map_file = tmp_path / 'params.yaml', tmp_path / 'map.db'
    params.write_text(f'encoder: {{name: variational, weights: {made["int8"]}}}\n')
    done('drive', one, '--params', params, '--map', map_file, '--session', 'one')
    assert 'model: variational, d = 8' in done('map', map_file)


def test_a_network_with_batch_normalisation_is_exported_without(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    trained, plain = tmp_path / 'trained.safetensors', tmp_path / 'plain.safetensors'
    config = NetworkConfig(backbone='vgg16_bn', dimension=8, side_px=32, resolution_m=4.0)
    save_network(trained, VariationalNetwork(config))
    done('export', trained, plain)
    before, after = (
        make_encoder(EncoderConfig(name='variational', weights=str(path), backend='torch')) for path in (trained, plain)
    )
    assert read_header(plain).config == dataclasses.replace(config, backbone='vgg16')
    assert after.info.fingerprint != before.info.fingerprint
    scan = BagSequence(street_bag('bag', count=1)).scan(0)
    np.testing.assert_allclose(after.encode(scan).mean, before.encode(scan).mean, atol=1e-4)


def test_weights_that_ship_are_exported_by_their_name(done: Callable[..., str], tmp_path: Path) -> None:
    out = tmp_path / 'own.onnx'
    shipped = make_encoder(EncoderConfig(name='variational', weights='compact')).info
    assert done('export', 'compact', out) == f'{out}: {shipped.fingerprint}\n'


def test_a_smaller_network_needs_drives(
    refused: Callable[..., str], weights: Path, street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    out, bag = tmp_path / 'out.onnx', street_bag('bag', count=1)
    for options in (['--int8'], ['--low-rank', 0.5]):
        assert 'expected --calibrate DRIVE' in refused('export', weights, out, *options)
    for options in ([], ['--low-rank', 1.0]):
        printed = refused('export', weights, out, '--calibrate', bag, *options)
        assert 'expected one of them, --low-rank below 1' in printed
    half = tmp_path / 'out.safetensors'
    assert '--int8 and --low-rank are for .onnx' in refused('export', weights, half, '--int8', '--calibrate', bag)
    missing = tmp_path / 'nothing'
    assert f'{missing}: no such folder' in refused('export', weights, out, '--int8', '--calibrate', missing)
    assert not out.exists()
    assert not half.exists()
