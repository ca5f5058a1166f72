from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.numpy import load_file, save, save_file

from offradar_ros import __version__
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.weights import load_weights, read_header, save_weights
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ModelError

CONFIG = NetworkConfig(backbone='compact', dimension=4, azimuths=64, range_bins=32)


def tensors() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {
        'a.weight': rng.normal(size=(3, 4)).astype(np.float32),
        'half': rng.normal(size=5).astype(np.float16),
        'turned': rng.normal(size=(2, 6)).astype(np.float32).T,
        'count': np.array(7, np.int64),
    }


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / 'net.safetensors'
    save_weights(path, CONFIG, tensors(), 'four tensors')
    return path


def metadata(**changes: str) -> dict[str, str]:
    header = WeightsHeader(CONFIG, 'ab' * 32)
    return {**header.to_metadata(), **{f'offradar.{key}': value for key, value in changes.items()}}


def test_round_trip(written: Path) -> None:
    header, found = load_weights(written)
    assert header == read_header(written)
    assert header.config == CONFIG
    assert header.description == 'four tensors'
    assert header.created_by == f'offradar_ros {__version__}'
    assert found.keys() == tensors().keys()
    for name, tensor in tensors().items():
        np.testing.assert_array_equal(found[name], tensor)
        assert found[name].dtype == (np.float32 if name == 'half' else tensor.dtype)
        assert found[name].shape == tensor.shape


def test_half_precision_rounds_only_matrices_and_changes_the_fingerprint(tmp_path: Path) -> None:
    exact = {
        'kernel': np.array([[1.0, 1.0 + 2**-20], [3.14159, -65000.0]], np.float32),
        'bias': np.array([1.0 + 2**-20], np.float32),
        'mask': np.array([[True, False]]),
    }
    header = save_weights(tmp_path / 'half.safetensors', CONFIG, exact, half=True)
    found_header, found = load_weights(tmp_path / 'half.safetensors')
    assert found_header == header
    assert header.stored == 'float16'
    assert load_file(tmp_path / 'half.safetensors')['kernel'].dtype == np.float16
    np.testing.assert_array_equal(found['kernel'], np.array([[1.0, 1.0], [3.140625, -64992.0]], np.float32))
    assert found['kernel'].dtype == np.float32
    for name in ('bias', 'mask'):
        np.testing.assert_array_equal(found[name], exact[name])
    # The same numbers in single precision are the same model; the exact ones are another.
    assert save_weights(tmp_path / 'same.safetensors', CONFIG, found).fingerprint == header.fingerprint
    assert save_weights(tmp_path / 'exact.safetensors', CONFIG, exact).fingerprint != header.fingerprint


def test_weights_beyond_half_precision_are_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r'big\.safetensors: tensor kernel holds numbers beyond half precision'):
        save_weights(tmp_path / 'big.safetensors', CONFIG, {'kernel': np.full((2, 2), 7e4, np.float32)}, half=True)
    assert not list(tmp_path.iterdir())


def test_no_other_file_is_written(written: Path) -> None:
    assert list(written.parent.iterdir()) == [written]


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    target = tmp_path / 'absent' / 'net.safetensors'
    with pytest.raises(ModelError, match=r'net\.safetensors: cannot be written \(No such file'):
        save_weights(target, CONFIG, tensors())


def test_a_file_in_place_of_a_folder_is_named(written: Path) -> None:
    with pytest.raises(ModelError, match=r'inner\.safetensors: cannot be written \(Not a directory'):
        save_weights(written / 'inner.safetensors', CONFIG, tensors())


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r'none\.safetensors: no such weights file'):
        read_header(tmp_path / 'none.safetensors')


@settings(max_examples=40, deadline=None)
@given(cut=st.floats(0.0, 1.0, exclude_max=True))
def test_truncated_file_is_refused_in_one_line(tmp_path_factory: pytest.TempPathFactory, cut: float) -> None:
    path = tmp_path_factory.mktemp('cut') / 'cut.safetensors'
    save_weights(path, CONFIG, tensors())
    content = path.read_bytes()
    path.write_bytes(content[: int(cut * len(content))])
    with pytest.raises(ModelError, match=r'cut\.safetensors: ') as refused:
        load_weights(path)
    assert '\n' not in str(refused.value)


@settings(max_examples=60, deadline=None)
@given(at=st.floats(0.0, 1.0, exclude_max=True), flip=st.integers(1, 255))
def test_a_changed_byte_never_gives_other_weights(
    tmp_path_factory: pytest.TempPathFactory, at: float, flip: int
) -> None:
    path = tmp_path_factory.mktemp('flip') / 'flip.safetensors'
    written = save_weights(path, CONFIG, tensors(), 'four tensors')
    content = bytearray(path.read_bytes())
    content[int(at * len(content))] ^= flip
    path.write_bytes(content)
    try:
        header, found = load_weights(path)
    except ModelError as error:
        assert 'flip.safetensors: ' in str(error)
        assert '\n' not in str(error)
    else:  # the byte was in the name of the digest, without which the fingerprint protects the weights
        assert header == written
        assert all(np.array_equal(found[name], tensor) for name, tensor in tensors().items())


def test_a_changed_description_is_noticed(written: Path) -> None:
    written.write_bytes(written.read_bytes().replace(b'four tensors', b'five tensors'))
    with pytest.raises(
        ModelError, match=r'net\.safetensors: damaged or altered: its content is not that of its digest'
    ):
        read_header(written)


def test_weights_of_an_earlier_version_have_no_digest_and_are_read(tmp_path: Path) -> None:
    path = tmp_path / 'old.safetensors'
    header = save_weights(path, CONFIG, tensors())
    path.write_bytes(save(load_file(path), header.to_metadata()))
    assert load_weights(path)[0] == header


@pytest.mark.parametrize('content', [b'', b'not weights', b'\x89PNG\r\n\x1a\n' + bytes(100), bytes(64)])
def test_another_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / 'foreign.safetensors'
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r'foreign\.safetensors: not a readable safetensors file'):
        read_header(path)


@pytest.mark.parametrize(
    ('header', 'length', 'reason'),
    [
        ('{}', 3, 'truncated, or no safetensors'),
        ('[]', 2, 'no header of safetensors'),
        ('{"__metadata__": []}', 20, 'no header of safetensors'),
        ('{"__metadata__": {"offradar.stored": 1}}', 40, 'no header of safetensors'),
    ],
)
def test_another_header_is_refused(tmp_path: Path, header: str, length: int, reason: str) -> None:
    path = tmp_path / 'foreign.safetensors'
    path.write_bytes(length.to_bytes(8, 'little') + header.encode())
    with pytest.raises(ModelError, match=rf'foreign\.safetensors: not a readable safetensors file \({reason}\)'):
        read_header(path)


def test_tensors_that_are_not_there_are_refused(tmp_path: Path) -> None:
    path = tmp_path / 'odd.safetensors'
    header = json.dumps(
        {'__metadata__': metadata(), 'kernel': {'dtype': 'F32', 'shape': [4], 'data_offsets': [0, 16]}}
    ).encode()
    path.write_bytes(len(header).to_bytes(8, 'little') + header)
    with pytest.raises(ModelError, match=r'odd\.safetensors: its tensors cannot be read \('):
        load_weights(path)


def test_a_file_beyond_bounds_is_not_read(written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('offradar_ros.encoders.model_files.MAX_MODEL_BYTES', 10)
    with pytest.raises(ModelError, match=r'net\.safetensors: cannot be read \(Larger than 10 bytes\)'):
        read_header(written)


def test_a_name_that_no_file_can_have_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r'cannot be read \(File name too long\)|no such weights file'):
        read_header(tmp_path / ('x' * 300))


@pytest.mark.parametrize('found', [None, {'format': 'pt'}])
def test_weights_of_another_program_are_refused(tmp_path: Path, found: dict[str, str] | None) -> None:
    path = tmp_path / 'other.safetensors'
    save_file(tensors(), path, found)
    with pytest.raises(ModelError, match=r'other\.safetensors: not offradar weights: its metadata has no offradar\.'):
        load_weights(path)


@pytest.mark.parametrize(
    'changes, expected',
    [
        ({'settings': '{}'}, 'network setting azimuths is missing'),
        ({'settings': '[]'}, 'network settings: expected an object'),
        ({'settings': 'nonsense'}, 'network settings: expected JSON'),
        ({'stored': 'float8'}, 'offradar.stored: expected one of float32, float16'),
        ({'fingerprint': 'xyz'}, 'offradar.fingerprint: expected 64 hexadecimal digits'),
        ({'fingerprint': 'cd' * 31}, 'offradar.fingerprint: expected 64 hexadecimal digits'),
        ({'fingerprint': 'cg' * 32}, 'offradar.fingerprint: expected 64 hexadecimal digits'),
        ({'fingerprint': 'cd' * 32}, 'damaged or altered: expected fingerprint cdcd'),
        (
            {'settings': dataclasses.replace(CONFIG, descriptor='z_i').to_json()},
            'damaged or altered',
        ),
    ],
)
def test_invalid_metadata_is_refused(tmp_path: Path, changes: dict[str, Any], expected: str) -> None:
    path = tmp_path / 'odd.safetensors'
    path.write_bytes(save(saved_tensors(tmp_path), metadata(**changes)))
    with pytest.raises(ModelError) as refused:
        load_weights(path)
    assert str(refused.value).startswith(f'{path}: {expected}')


def saved_tensors(folder: Path) -> dict[str, np.ndarray]:
    path = folder / 'good.safetensors'
    save_weights(path, CONFIG, tensors())
    found: dict[str, np.ndarray] = load_file(path)
    return found
