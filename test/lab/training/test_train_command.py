"""`offradar train` from the command line, and its runs."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

pytest.importorskip('torch')

import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from offradar_ros.cli.main import app
from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.encoders.weights import read_header
from offradar_ros.errors import ConfigError, DataError, ModelError
from offradar_ros.lab.training.config import DataConfig
from offradar_ros.lab.training.config_file import read_config
from offradar_ros.lab.training.run import RunOptions, run
from offradar_ros.lab.training.run_log import read_log
from offradar_ros.lab.training.simulated_drives import city_drive

PROJECT = Path(__file__).resolve().parents[3]
SMOKE = PROJECT / 'params' / 'train' / 'smoke.yaml'
ALONE = {**os.environ, 'OMP_NUM_THREADS': '1', 'CUDA_VISIBLE_DEVICES': ''}
WAIT_S = 900.0
"""Time limit of a run: many times its usual duration, because the machine may be busy."""
pytestmark = pytest.mark.timeout(2 * WAIT_S)


@pytest.fixture(scope='module')
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made by the first run that needs it."""
    return tmp_path_factory.mktemp('cache')


def command(out: Path, cache: Path, *more: str) -> list[str]:
    fixed = ['-m', 'offradar_ros.cli.main', 'train', '--config', str(SMOKE), '--out', str(out), '--cache', str(cache)]
    return [*fixed, '--device', 'cpu', *more]


def train(out: Path, cache: Path, *more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *command(out, cache, *more)],
        cwd=PROJECT,
        env=ALONE,
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_run_writes_weights_that_encode_and_a_record_of_its_settings(tmp_path: Path, cache: Path) -> None:
    done = train(tmp_path / 'out', cache)
    assert done.returncode == 0, done.stderr
    assert f'{tmp_path / "out"}/best.safetensors: written, validation score' in done.stdout
    written = {path.name for path in (tmp_path / 'out').iterdir()}
    assert written >= {
        'best.safetensors',
        'last.safetensors',
        'checkpoint.safetensors',
        'config.yaml',
        'run.jsonl',
        'log.jsonl',
        'validation.jsonl',
    }
    assert read_config(tmp_path / 'out' / 'config.yaml') == read_config(SMOKE)
    record = json.loads((tmp_path / 'out' / 'run.jsonl').read_text())
    assert (record['scans'], record['drives'], record['processes']) == (20, 2, 1)
    assert record['torch'] and record['numpy'] and '--config' in record['command']
    encoder = make_encoder(EncoderConfig('variational', str(tmp_path / 'out' / 'best.safetensors')))
    scan = city_drive(3, 0, DataConfig(scans=1, degraded=0.0, physics='nominal')).open().scan(0)
    embedding = encoder.encode(scan)
    assert embedding.mean.shape == embedding.variance.shape == (16,)
    assert 0.0 < embedding.uncertainty < 100.0

    again = train(tmp_path / 'out', cache)
    assert again.returncode == 1
    assert again.stderr.splitlines()[-1] == (
        f'error: {tmp_path / "out"}: has a training run already: expected --resume to continue it, or another folder'
    )


def test_a_stopped_run_is_resumed(tmp_path: Path, cache: Path) -> None:
    options = RunOptions(cache, device='cpu')
    config = read_config(SMOKE)
    stopped = run(config, tmp_path / 'out', options._replace(minutes=0.0))
    assert (stopped.finished, stopped.step) == (False, 1)
    with pytest.raises(ConfigError, match='its run was started with another seed: expected 1'):
        run(read_config(SMOKE, ['seed=2']), tmp_path / 'out', options._replace(resume=True))
    validated_more_often = read_config(SMOKE, ['validation.every_steps=2', 'log_steps=1'])
    resumed = run(validated_more_often, tmp_path / 'out', options._replace(resume=True))
    assert (resumed.finished, resumed.step) == (True, 6)
    with pytest.raises(DataError, match='no checkpoint to resume from'):
        run(config, tmp_path / 'other', options._replace(resume=True))


def test_a_checkpoint_without_a_newer_key_is_resumed(tmp_path: Path, cache: Path) -> None:
    options = RunOptions(cache, device='cpu')
    run(read_config(SMOKE), tmp_path / 'out', options._replace(minutes=0.0))
    checkpoint = tmp_path / 'out' / 'checkpoint.safetensors'
    with safe_open(checkpoint, framework='pt') as opened:
        tensors, metadata = {name: opened.get_tensor(name) for name in list(opened.keys())}, opened.metadata()
    state = json.loads(metadata['offradar.training'])
    del state['config']['refinement']
    save_file(tensors, checkpoint, metadata={'offradar.training': json.dumps(state)})
    assert run(read_config(SMOKE), tmp_path / 'out', options._replace(resume=True)).finished


def test_vgg16_learns_from_another_network_and_goes_on_with_larger_images(tmp_path: Path, cache: Path) -> None:
    """Both sizes use the same cached scans, the same outputs of the teacher, chunks and averaged weights."""
    options = RunOptions(cache, device='cpu')
    assert run(read_config(SMOKE), tmp_path / 'teacher', options).finished
    common = [
        'network.backbone=vgg16',
        f'distillation.weights={tmp_path / "teacher" / "best.safetensors"}',
        'cached_bin_m=0.5',
        'batch.chunk=3',
        'optimiser.average=0.9',
        'optimiser.frozen_groups=2',
        'steps=3',
    ]
    small = read_config(SMOKE, [*common, 'network.side_px=32', 'network.resolution_m=4'])
    first = run(small, tmp_path / 'small', options)
    assert first.finished
    scans = sorted(path.name for path in cache.rglob('*.npy'))
    given = tmp_path / 'given.safetensors'
    shutil.copy(first.best, given)
    sizes = ['network.side_px=64', 'network.resolution_m=2', f'initial.weights={given}']
    large = read_config(SMOKE, [*common, *sizes])
    whole = run(large, tmp_path / 'whole', options)
    assert not run(large, tmp_path / 'parts', options._replace(minutes=0.0)).finished
    given.unlink()
    parts = run(large, tmp_path / 'parts', options._replace(resume=True))
    assert parts.finished and parts.score == whole.score
    assert sorted(path.name for path in cache.rglob('*.npy')) == scans
    assert sum(path.parent.name.startswith('teacher-') for path in cache.rglob('*.npy')) == 2
    for name in ('best', 'last'):
        files = [load_file(tmp_path / out / f'{name}.safetensors') for out in ('whole', 'parts')]
        assert all(torch.equal(tensor, files[1][key]) for key, tensor in files[0].items())
    before, after = load_file(first.best), load_file(parts.best)
    assert torch.allclose(
        before['features.backbone.features.0.weight'], after['features.backbone.features.0.weight'], atol=0.1
    )
    assert after['z_i.weight'].shape == (16, 4 * before['z_i.weight'].shape[1])


@pytest.mark.parametrize('stop_teacher', [True, False])
def test_a_student_learns_from_its_teacher(tmp_path: Path, cache: Path, stop_teacher: bool) -> None:
    config = read_config(SMOKE, ['network.method=stun', 'teacher.steps=2', 'steps=2'])
    options = RunOptions(cache, device='cpu')
    if stop_teacher:
        assert not run(config, tmp_path / 'out', options._replace(minutes=0.0)).finished
        assert not (tmp_path / 'out' / 'checkpoint.safetensors').exists()
    done = run(config, tmp_path / 'out', options._replace(resume=stop_teacher))
    assert (done.finished, done.step) == (True, 2)
    teacher = tmp_path / 'out' / 'teacher' / 'last.safetensors'
    given = read_config(SMOKE, ['network.method=stun', f'teacher.weights={teacher}', 'steps=1'])
    assert run(given, tmp_path / 'given', options).finished
    assert not (tmp_path / 'given' / 'teacher').exists()


REFINED = [
    f'refinement.{setting}'
    for setting in ('steps=3', 'scans=8', 'data.worlds=1', 'data.drives=2', 'data.scans=10', 'data.spacing_m=20')
]


@pytest.mark.parametrize('stop_first', [True, False])
def test_a_second_stage_follows_the_first(tmp_path: Path, cache: Path, stop_first: bool) -> None:
    config, options = read_config(SMOKE, REFINED), RunOptions(cache, device='cpu')
    if stop_first:
        assert not run(config, tmp_path / 'out', options._replace(minutes=0.0)).finished
        assert not (tmp_path / 'out' / 'best.safetensors').exists()
    done = run(config, tmp_path / 'out', options._replace(resume=stop_first))
    assert (done.finished, done.step, done.best) == (True, 3, tmp_path / 'out' / 'best.safetensors')
    assert [line['step'] for line in read_log(tmp_path / 'out' / 'validation.jsonl')] == [0, 3]
    assert [line['step'] for line in read_log(tmp_path / 'out' / 'log.jsonl')] == [2, 3]
    first = tmp_path / 'out' / 'first' / 'best.safetensors'
    with pytest.raises(DataError, match='has a training run already'):
        run(config, tmp_path / 'out', options)

    given = read_config(SMOKE, [*REFINED, f'refinement.weights={first}'])
    again = run(given, tmp_path / 'given', options)
    assert again.score == done.score
    assert not (tmp_path / 'given' / 'first').exists()
    assert read_header(again.best).fingerprint == read_header(done.best).fingerprint


def test_a_second_stage_that_does_not_fit_is_refused(tmp_path: Path, cache: Path) -> None:
    options = RunOptions(cache, device='cpu')
    with pytest.raises(ConfigError, match=r'key refinement\.steps: expected 0, as bc_radar has no second stage'):
        run(read_config(SMOKE, [*REFINED, 'network.method=bc_radar']), tmp_path / 'bc_radar', options)
    first = run(read_config(SMOKE, ['validation.worlds=0']), tmp_path / 'first', options).best
    settings = [*REFINED, f'refinement.weights={first}', 'network.dimension=8']
    with pytest.raises(ConfigError, match='expected weights of the configured network'):
        run(read_config(SMOKE, settings), tmp_path / 'refined', options)
    alone = [*REFINED, f'refinement.weights={first}', 'refinement.data.drives=1']
    with pytest.raises(ConfigError, match=r'key refinement\.data: expected two drives or more through'):
        run(read_config(SMOKE, alone), tmp_path / 'alone', options)
    with pytest.raises(ConfigError, match=r'expected 0, as rad_vlad has no second stage'):
        run(read_config(SMOKE, [*REFINED, 'fit=rad_vlad']), tmp_path / 'rad_vlad', options)


def test_a_resumed_run_has_the_stages_of_its_start(tmp_path: Path, cache: Path) -> None:
    options = RunOptions(cache, device='cpu', minutes=0.0)
    one, two = read_config(SMOKE), read_config(SMOKE, REFINED)
    run(one, tmp_path / 'one', options)
    run(two, tmp_path / 'two', options)
    for out, other, word in (('one', two, 'without'), ('two', one, 'with')):
        with pytest.raises(ConfigError, match=f'its run was started {word} a second stage'):
            run(other, tmp_path / out, options._replace(resume=True))


def test_a_run_may_stop_between_its_stages(tmp_path: Path, cache: Path) -> None:
    options = RunOptions(cache, device='cpu', minutes=0.0)
    config = read_config(SMOKE, [*REFINED, 'steps=1', 'checkpoint_steps=1'])
    stopped = run(config, tmp_path / 'out', options)
    assert not stopped.finished
    assert not (tmp_path / 'out' / 'best.safetensors').exists()
    assert run(config, tmp_path / 'out', options._replace(resume=True, minutes=None)).finished


def test_without_validation_the_last_weights_are_the_result(tmp_path: Path, cache: Path) -> None:
    done = run(read_config(SMOKE, ['validation.worlds=0']), tmp_path / 'out', RunOptions(cache, device='cpu'))
    assert done.best == tmp_path / 'out' / 'last.safetensors'
    assert done.score != done.score
    assert not (tmp_path / 'out' / 'best.safetensors').exists()


@pytest.mark.parametrize(
    ('setting', 'message'),
    [
        ('data.worlds=0', 'nothing to train on: expected data.worlds, data.sequences or data.split'),
        ('batch.places=400', 'expected fewer batch.places or more data'),
        ('validation.drives=1', 'validation: expected two drives or more through at least one world'),
    ],
)
def test_too_little_data_is_reported_before_training(tmp_path: Path, cache: Path, setting: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        run(read_config(SMOKE, [setting]), tmp_path / 'out', RunOptions(cache, device='cpu'))
    assert not list((tmp_path / 'out').glob('*.safetensors'))


def test_settings_that_cannot_be_trained_are_reported_before_a_scan_is_made(tmp_path: Path) -> None:
    for settings, message in (
        (['network.method=stun', 'teacher.weights=nowhere.safetensors'], 'nowhere.safetensors: no such weights file'),
        (['network.method=bc_radar', 'loss.invariant.weight=0'], 'key loss.invariant.weight'),
        (['initial.weights=nowhere.safetensors'], 'nowhere.safetensors: no such weights file'),
        (['distillation.weights=nowhere.safetensors'], 'nowhere.safetensors: no such weights file'),
        (['distillation.weights=compact'], 'expected a variational network of dimension 16 as the teacher'),
        (['distillation.weights=compact', 'network.method=vae'], 'expected none, as vae is not distilled'),
    ):
        with pytest.raises((ConfigError, ModelError), match=message):
            run(read_config(SMOKE, settings), tmp_path / 'out', RunOptions(tmp_path / 'cache', device='cpu'))
    assert not (tmp_path / 'cache').exists()


def test_an_unknown_device_is_an_error_of_one_line(tmp_path: Path, cache: Path) -> None:
    done = CliRunner().invoke(app, [*command(tmp_path, cache)[2:], '--device', 'tpu'])
    assert isinstance(done.exception, ConfigError)
    assert str(done.exception) == "--device: expected one of auto, cpu, cuda, got 'tpu'"


def test_ctrl_c_writes_a_checkpoint(tmp_path: Path, cache: Path) -> None:
    out = tmp_path / 'out'
    slow = ['--set', 'steps=100000', '--set', 'log_steps=1', '--set', 'validation.every_steps=100000']
    process = subprocess.Popen(
        [sys.executable, *command(out, cache, *slow)], cwd=PROJECT, env=ALONE, stderr=subprocess.PIPE
    )
    try:
        deadline_s = time.monotonic() + WAIT_S
        while not ((out / 'log.jsonl').exists() and (out / 'log.jsonl').read_text()):
            assert process.poll() is None
            assert time.monotonic() < deadline_s
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=WAIT_S)
    finally:
        process.kill()
    assert process.returncode != 0
    resumed = run(read_config(SMOKE, slow[1::2]), out, RunOptions(cache, True, 0.0, 'cpu'))
    assert resumed.step > 1


def test_processes_of_torchrun_train_one_network(tmp_path: Path, cache: Path) -> None:
    out = tmp_path / 'out'
    done = subprocess.run(
        [sys.executable, '-m', 'torch.distributed.run', '--standalone', '--nproc-per-node', '2', *command(out, cache)],
        cwd=PROJECT,
        env=ALONE,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('best.safetensors: written') == 1
    assert json.loads((out / 'run.jsonl').read_text())['processes'] == 2
    assert [json.loads(line)['step'] for line in (out / 'log.jsonl').read_text().splitlines()] == [2, 4, 6]


def test_training_loads_neither_ros_nor_bags_nor_projections() -> None:
    names = [
        '.'.join(path.relative_to(PROJECT).with_suffix('').parts)
        for path in sorted((PROJECT / 'offradar_ros' / 'lab' / 'training').rglob('*.py'))
        if path.stem != '__init__'
    ]
    code = f"""
import importlib, sys
from offradar_ros.cli.main import app
for name in {[*names, 'offradar_ros.lab.cli.train']!r}:
    importlib.import_module(name)
from typer.testing import CliRunner
assert CliRunner().invoke(app, ['train', '--help']).exit_code == 0
print(*sys.modules)
"""
    done = subprocess.run([sys.executable, '-c', code], cwd=PROJECT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.split())
    assert 'torch' in loaded
    assert loaded.isdisjoint({'rclpy', 'rosbags', 'pyproj', 'matplotlib', 'onnxruntime', 'onnx', 'scipy'})
