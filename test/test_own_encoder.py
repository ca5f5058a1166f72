"""The encoder of docs/examples in all commands that take an encoder; its test in a node is in test/nodes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from offradar_ros.config import EncoderConfig, load_config
from offradar_ros.encoders.entry_points import installed_names
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.sequence import RadarSequence
from offradar_ros.stages.encode import EncodeStage

PROJECT = Path(__file__).resolve().parent.parent
EXAMPLE = PROJECT / 'docs' / 'examples' / 'own_encoder'


def test_the_example_is_installed_by_pip(tmp_path: Path) -> None:
    sources = tmp_path / 'sources'
    sources.mkdir()
    for file in EXAMPLE.iterdir():
        if file.is_file():
            (sources / file.name).write_bytes(file.read_bytes())
    options = ['--quiet', '--no-deps', '--no-build-isolation', '--no-index', '--disable-pip-version-check']
    command = [sys.executable, '-m', 'pip', 'install', *options, '--target', str(tmp_path / 'site'), str(sources)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if 'No module named pip' in done.stderr:
        pytest.skip('this environment has no pip')
    assert done.returncode == 0, done.stderr
    code = (
        f'import sys; sys.path.insert(0, {str(tmp_path / "site")!r}); '
        'from offradar_ros.config import EncoderConfig; from offradar_ros.encoders.registry import make_encoder; '
        'print(make_encoder(EncoderConfig(name="median_rings")).info.name)'
    )
    made = subprocess.run([sys.executable, '-c', code], cwd=PROJECT, capture_output=True, text=True, check=False)
    assert (made.returncode, made.stdout.strip()) == (0, 'median_rings'), made.stderr


def test_a_stage_encodes_with_it(own_encoder: str, street: Callable[..., RadarSequence]) -> None:
    assert own_encoder in installed_names()
    encoder = make_encoder(EncoderConfig(name=own_encoder))
    assert isinstance(encoder, Encoder)
    drive = street(count=2)
    stage = EncodeStage(encoder, 1.0, signature=True)
    encoded = stage.encode(int(drive.stamps_ns[0]), lambda: drive.scan(0))
    assert encoded.problem is None
    assert encoded.embedding is not None
    assert encoded.embedding.mean.shape == encoded.embedding.variance.shape == (64,)
    silent = stage.encode(int(drive.stamps_ns[1]), lambda: street(count=2, silent=True).scan(1))
    assert silent.problem is not None
    assert silent.problem.cause == 'no_signal'


def test_drive_maps_and_queries_with_it(
    own_encoder: str, done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    (tmp_path / 'own.yaml').write_text(f'encoder: {{name: {own_encoder}}}\nquery: {{delta: 100.0}}\n')
    named = ['--params', tmp_path / 'own.yaml', '--map', tmp_path / 'map.db']
    done('drive', street_bag('one', count=6), *named, '--session', 'one')
    output = done('drive', street_bag('two', count=6, noise_seed=1), *named, '--out', tmp_path / 'answers.csv')
    assert 'match' in output
    assert (tmp_path / 'answers.csv').is_file()


def test_calibrate_writes_thresholds_for_it(
    own_encoder: str, done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    (tmp_path / 'own.yaml').write_text(f'encoder: {{name: {own_encoder}}}\n')
    calibrated = tmp_path / 'calibrated.yaml'
    done('calibrate', street_bag('bag', count=6), '--params', tmp_path / 'own.yaml', '--out', calibrated)
    config = load_config(calibrated)
    assert config.encoder.name == own_encoder
    assert config.query.model == make_encoder(config.encoder).info.fingerprint


def test_evaluate_compares_it(
    own_encoder: str, done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bags = [street_bag(f'day_{number}', count=6, noise_seed=number) for number in range(2)]
    methods = ['--method', own_encoder, '--method', f'again={own_encoder}:weights.npz', '--method', 'ring_key']
    named = ['--map', bags[0], '--query', bags[1], '--cache', tmp_path / 'cache', '--no-pictures']
    done('evaluate', *named, *methods, '--out', tmp_path / 'out')
    results = json.loads((tmp_path / 'out' / 'results.json').read_text())
    assert set(results['methods']) == {own_encoder, 'again', 'ring_key'}
