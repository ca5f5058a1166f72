"""ONNX files are read as they were exported, or refused."""

from __future__ import annotations

import hashlib
import os
import random
from pathlib import Path

import pytest

from offradar_ros.encoders.onnx_digest import digest_is_right, has_digest, with_digest
from offradar_ros.encoders.onnx_file import metadata_entry
from offradar_ros.encoders.onnx_model import PROBE, header_of, read_onnx
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.errors import ModelError

COMPACT = find_weights('compact', ('.onnx',))
SEED, FLIPS = 20, 60


def test_every_flipped_bit_of_the_shipped_network_is_noticed(tmp_path: Path) -> None:
    content, random_ = bytearray(COMPACT.read_bytes()), random.Random(SEED)
    path = tmp_path / 'flipped.onnx'
    # The last bytes are metadata and the digest itself.
    places = [random_.randrange(len(content)) for _ in range(FLIPS // 2)]
    places += [len(content) - 1 - random_.randrange(3000) for _ in range(FLIPS // 2)]
    for at in places:
        bit = 1 << random_.randrange(8)
        content[at] ^= bit
        path.write_bytes(content)
        with pytest.raises(ModelError, match=r'flipped\.onnx: ') as refused:
            read_onnx(path)
        assert '\n' not in str(refused.value)
        content[at] ^= bit
    path.write_bytes(content)
    assert read_onnx(path).header == read_onnx(COMPACT).header


def test_every_damage_of_a_file_without_digest_is_refused_or_harmless(tmp_path: Path) -> None:
    """Nothing tells that it is damaged before a runtime reads it."""
    content, random_, path = COMPACT.read_bytes()[:-85], random.Random(SEED), tmp_path / 'old.onnx'
    unreadable = 0
    for _ in range(400):
        flipped = bytearray(content)
        flipped[random_.randrange(min(len(content), 40_000))] ^= 1 << random_.randrange(8)
        try:
            header_of(bytes(flipped), path)
        except ModelError as refused:
            assert '\n' not in str(refused)
            unreadable += 'not a readable ONNX file' in str(refused)
    assert unreadable > 0


@pytest.mark.parametrize('more', [b'', b'\0', b'more'])
def test_what_is_cut_off_or_added_is_noticed(tmp_path: Path, more: bytes) -> None:
    path, content = tmp_path / 'other.onnx', COMPACT.read_bytes()
    path.write_bytes(content + more if more else content[:-1])
    with pytest.raises(ModelError, match=r'other\.onnx: '):
        read_onnx(path)


def test_the_digest_covers_all_before_it() -> None:
    content = with_digest(b'content')
    assert has_digest(content)
    assert digest_is_right(content)
    assert not digest_is_right(b'C' + content[1:])
    assert not has_digest(b'content')
    assert not digest_is_right(b'content' + hashlib.sha256(b'content').hexdigest().encode())


@pytest.mark.parametrize('probe', ['nonsense', '{}', '{"mean": [1.0], "variance": "none"}'])
def test_a_file_without_what_the_network_gives_is_refused(tmp_path: Path, probe: str) -> None:
    path = tmp_path / 'odd.onnx'
    path.write_bytes(with_digest(COMPACT.read_bytes()[:-85] + metadata_entry(PROBE, probe)))
    with pytest.raises(ModelError, match=r'odd\.onnx: offradar\.probe: ') as refused:
        read_onnx(path)
    assert '\n' not in str(refused.value)


def test_a_file_without_digest_is_refused_with_the_way_out(tmp_path: Path) -> None:
    path = tmp_path / 'old.onnx'
    path.write_bytes(COMPACT.read_bytes()[:-85])
    with pytest.raises(ModelError, match=rf'has no digest.* offradar export {path} NEW\.onnx$'):
        read_onnx(path)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe.onnx')
    with pytest.raises(ModelError, match=r'pipe\.onnx: no such weights file'):
        read_onnx(tmp_path / 'pipe.onnx')
