"""The package root: its exports, and what an import of it loads."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import offradar_ros
from offradar_ros import EXPORTS

PROJECT = Path(__file__).resolve().parent.parent
NAMES = [(module, name) for module, names in EXPORTS.items() for name in names]


@pytest.mark.parametrize(('module', 'name'), NAMES)
def test_an_export_is_the_object_of_its_module(module: str, name: str) -> None:
    __import__(f'offradar_ros.{module}')
    assert getattr(offradar_ros, name) is getattr(sys.modules[f'offradar_ros.{module}'], name)


def test_type_checkers_see_the_same_names() -> None:
    tree = ast.parse((PROJECT / 'offradar_ros' / '__init__.py').read_text(encoding='utf-8'))
    (typed,) = [node for node in tree.body if isinstance(node, ast.If) and isinstance(node.test, ast.Name)]
    imports = [node for node in typed.body if isinstance(node, ast.ImportFrom)]
    assert [(str(node.module), alias.name) for node in imports for alias in node.names] == [
        (f'offradar_ros.{module}', name) for module, name in NAMES
    ]


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'offradar_ros' has no attribute 'decode_jpg'"):
        _ = offradar_ros.decode_jpg  # type: ignore[attr-defined]
    with pytest.raises(ImportError, match='decode_jpg'):
        exec('from offradar_ros import decode_jpg')


def test_dir_lists_the_exports() -> None:
    assert {*offradar_ros.__all__, '__version__'} <= set(dir(offradar_ros))


def test_importing_the_root_loads_nothing() -> None:
    code = 'import sys, offradar_ros; print(*sys.modules)'
    ran = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True, cwd=PROJECT)
    loaded = ran.stdout.split()
    assert 'offradar_ros' in loaded
    assert [name for name in loaded if name.startswith('offradar_ros.') or name in ('numpy', 'cv2', 'yaml')] == []
