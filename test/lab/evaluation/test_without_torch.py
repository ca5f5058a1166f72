"""An evaluation where torch is not installed: the weights that ship run as ONNX."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from absent_packages import environment_without

from offradar_ros.lab.evaluation.results.file import read_results

PROJECT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize('absent', [('torch',), ('torch', 'onnxruntime', 'onnx')], ids=['onnx runtime', 'opencv'])
def test_the_weights_that_ship_are_compared(
    absent: tuple[str, ...], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    if 'onnxruntime' not in absent:
        pytest.importorskip('onnxruntime')
    bags = [street_bag(f'day_{number}', count=5, noise_seed=number) for number in range(2)]
    named = ['--map', bags[0], '--query', bags[1], '--cache', tmp_path / 'cache', '--no-pictures']
    methods = ['--method', 'ours=compact', '--method', 'ring_key', '--out', tmp_path / 'out']
    command = [sys.executable, '-m', 'offradar_ros.cli.main', 'evaluate', *map(str, [*named, *methods])]
    environment = os.environ | environment_without(absent, tmp_path / 'without')
    ran = subprocess.run(command, env=environment, cwd=PROJECT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    results = read_results(tmp_path / 'out' / 'results.json')
    assert set(results.methods) == {'ours', 'ring_key'}
    assert results.methods['ours'].weights.endswith('compact.onnx')
