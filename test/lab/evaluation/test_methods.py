"""What `--method` takes, and what it says of what it does not take."""

from __future__ import annotations

from pathlib import Path

import pytest

from offradar_ros.errors import ConfigError, ModelError
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
    ('text', 'said'),
    [
        ('outs=compact', "got 'outs'; did you mean ours? (a variant is LABEL=NAME:WEIGHTS)"),
        ('night=compact', 'expected one of ours, bc_radar, vae, mc_dropout, stun, ring_key, rad_vlad, '),
        ('night=outs:compact', "got 'night'"),
        ('', "got ''"),
        ('=compact', "got ''"),
        ('=ours:compact', "expected a label that is no encoder of its own, got ''"),
        ('stun=ours:compact', "expected a label that is no encoder of its own, got 'stun'"),
        ('ours', 'ours needs weights: expected ours=WEIGHTS, such as ours=compact'),
        ('stun=', 'stun needs weights: expected stun=WEIGHTS'),
        ('night=stun:', 'stun needs weights: expected stun=WEIGHTS'),
        ('ring_key=compact', 'ring_key has no weights'),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError) as refused:
        opened(text, tmp_path)
    assert str(refused.value).startswith(f'--method {text}: ')
    assert said in str(refused.value)


def test_the_folder_of_a_run_means_its_best_weights(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r'best\.safetensors: '):
        opened(f'ours={tmp_path}', tmp_path)


def test_weights_of_another_method_are_refused(tmp_path: Path) -> None:
    pytest.importorskip('onnxruntime')
    with pytest.raises(ConfigError, match='holds a network of variational'):
        opened('stun=compact', tmp_path)
