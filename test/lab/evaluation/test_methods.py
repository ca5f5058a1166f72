"""Methods from the text of `--method`, and the messages for a text that does not fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from offradar_ros.config import RingKeyConfig
from offradar_ros.encoders.ring_key import RingKeyEncoder
from offradar_ros.errors import ConfigError, ModelError
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.methods import METHODS, Method, open_method


def opened(text: str, folder: Path) -> Method:
    return open_method(text, folder, seed=1, spacing_m=5.0)


def test_methods_are_in_the_order_of_the_papers_tables() -> None:
    assert tuple(METHODS) == ('ours', 'bc_radar', 'vae', 'mc_dropout', 'stun', 'ring_key', 'rad_vlad')


@pytest.mark.parametrize(
    ('text', 'name', 'weights'),
    [
        ('ring_key', 'ring_key', ''),
        ('rad_vlad', 'rad_vlad', ''),
        ('ours=compact', 'ours', 'compact'),
        ('night=ours:compact', 'night', 'compact'),
        ('again=ring_key:', 'again', ''),
    ],
)
def test_a_method_is_opened(tmp_path: Path, text: str, name: str, weights: str) -> None:
    pytest.importorskip('onnxruntime')
    method = opened(text, tmp_path)
    assert (method.name, Path(method.weights).stem) == (name, weights)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('outs=compact', "got 'outs'; did you mean ours? (a variant is LABEL=NAME:WEIGHTS)"),
        ('night=compact', 'expected one of ours, bc_radar, vae, mc_dropout, stun, ring_key, rad_vlad, '),
        ('night=outs:compact', "got 'night'"),
        ('', "got ''"),
        ('=compact', "got ''"),
        ('=ours:compact', "expected a label that is not the name of an encoder, got ''"),
        ('stun=ours:compact', "expected a label that is not the name of an encoder, got 'stun'"),
        ('ours', 'ours needs weights: expected ours=WEIGHTS, such as ours=compact'),
        ('stun=', 'stun needs weights: expected stun=WEIGHTS'),
        ('night=stun:', 'stun needs weights: expected stun=WEIGHTS'),
        ('ring_key=compact', 'ring_key has no weights'),
    ],
)
def test_a_text_that_does_not_fit_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as refused:
        opened(text, tmp_path)
    assert str(refused.value).startswith(f'--method {text}: ')
    assert message in str(refused.value)


def test_the_folder_of_a_training_run_gives_its_best_weights(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r'best\.safetensors: '):
        opened(f'ours={tmp_path}', tmp_path)


def test_weights_of_another_method_are_refused(tmp_path: Path) -> None:
    pytest.importorskip('onnxruntime')
    with pytest.raises(ConfigError, match='holds a network of variational'):
        opened('stun=compact', tmp_path)


def test_rad_vlad_is_fitted_to_each_map_once(embedded_street: Callable[..., EmbeddedDrive], tmp_path: Path) -> None:
    pytest.importorskip('safetensors')
    method = open_method('rad_vlad', tmp_path, seed=3, spacing_m=5.0)
    assert method.fitted
    one, two = (embedded_street(index, 12).drive for index in range(2))
    first = method.encoder_for(one).info.fingerprint
    assert method.encoder_for(two).info.fingerprint != first
    assert method.encoder_for(one).info.fingerprint == first
    assert len(list(tmp_path.rglob('*.safetensors'))) == 2


def test_the_ring_key_is_one_encoder_for_every_map(
    embedded_street: Callable[..., EmbeddedDrive], tmp_path: Path
) -> None:
    method = open_method('ring_key', tmp_path, seed=0, spacing_m=5.0)
    assert not method.fitted
    for index in range(2):
        info = method.encoder_for(embedded_street(index, 3).drive).info
        assert info.fingerprint == RingKeyEncoder(RingKeyConfig()).info.fingerprint
