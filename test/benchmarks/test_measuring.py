"""What a result says of its own making."""

from __future__ import annotations

from pathlib import Path

import pytest
from measuring import as_typed, made_by_this_code

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


def test_what_other_code_made_is_removed_and_what_this_made_is_kept(tmp_path: Path) -> None:
    old, other = tmp_path / 'made_by_0123456789ab', tmp_path / 'logs'
    for folder in (old, other):
        folder.mkdir()
        (folder / 'file').touch()
    made = made_by_this_code(tmp_path)
    (made / 'drive').touch()
    assert made_by_this_code(tmp_path) == made
    assert (made / 'drive').exists() and (other / 'file').exists() and not old.exists()
