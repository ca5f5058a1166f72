"""The command lines in results, and the folder of generated files."""

from __future__ import annotations

from pathlib import Path

import pytest
from measuring import cache_folder, portable_command

PROJECT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ('words', 'expected'),
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
def test_a_command_contains_no_path_outside_the_project(words: list[str], expected: str) -> None:
    assert portable_command(words) == expected


def test_files_of_other_code_are_removed(tmp_path: Path) -> None:
    old, other = tmp_path / 'made_by_0123456789ab', tmp_path / 'logs'
    for folder in (old, other):
        folder.mkdir()
        (folder / 'file').touch()
    made = cache_folder(tmp_path)
    (made / 'drive').touch()
    assert cache_folder(tmp_path) == made
    assert (made / 'drive').exists() and (other / 'file').exists() and not old.exists()
