"""What a result says of its own making."""

from __future__ import annotations

from pathlib import Path

import pytest
from measuring import as_typed

PROJECT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['python', f'{PROJECT}/benchmarks/search.py', 'merge'], 'python benchmarks/search.py merge'),
        (['--folder', '/somewhere/else/maps', '--out=../results.json'], '--folder maps --out=results.json'),
        (
            [f'vgg16={PROJECT}/runs/best.safetensors', 'own=/home/me/best.onnx'],
            'vgg16=runs/best.safetensors own=best.onnx',
        ),
        (['--variants', 'low rank 0.5', '--seconds', '600'], "--variants 'low rank 0.5' --seconds 600"),
    ],
)
def test_a_command_names_no_place_outside_the_project(words: list[str], told: str) -> None:
    assert as_typed(words) == told
