"""The metadata are consistent, and the source compiles for every Python version in them."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from offradar_ros import __version__

PROJECT = Path(__file__).resolve().parent.parent
MANIFEST = ElementTree.parse(PROJECT / 'package.xml').getroot()
PYTHONS = tuple(f'3.{minor}' for minor in range(10, 14))
FOLDERS = ('offradar_ros', 'test', 'benchmarks', 'launch', 'docs')
SOURCES = [
    PROJECT / 'setup.py',
    *(file for folder in FOLDERS for file in sorted((PROJECT / folder).rglob('*.py'))),
    *(file for file in sorted((PROJECT / 'scripts').iterdir()) if file.is_file()),
]
COMPILE = (
    'import sys; [compile(open(name, encoding="utf-8").read(), name, "exec") for name in sys.stdin.read().split()]'
)


def setup_py(option: str) -> list[str]:
    command = [sys.executable, 'setup.py', option]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, cwd=PROJECT)
    return ran.stdout.splitlines()


def test_the_version_is_that_of_the_manifest() -> None:
    assert setup_py('--version') == [__version__] == [MANIFEST.findtext('version')]


def test_the_changelog_has_the_next_or_this_version_first() -> None:
    changelog = (PROJECT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    first = re.findall(r'^(.+)\n-+$', changelog, re.MULTILINE)[0]
    assert first == 'Forthcoming' or first.startswith(f'{__version__} (')


def test_every_document_names_the_same_pythons() -> None:
    assert [line for line in setup_py('--classifiers') if 'Python ::' in line] == [
        f'Programming Language :: Python :: {version}' for version in PYTHONS
    ]
    expected = f'{PYTHONS[0]} to {PYTHONS[-1]}'
    for name in ('Makefile', 'README.md', 'CONTRIBUTING.md', 'QUALITY_DECLARATION.md', 'constraints.txt'):
        assert expected in (PROJECT / name).read_text(encoding='utf-8'), name
    pyproject = (PROJECT / 'pyproject.toml').read_text(encoding='utf-8')
    assert f'python_version = "{PYTHONS[0]}"' in pyproject
    assert f'target-version = "py{PYTHONS[0].replace(".", "")}"' in pyproject


def test_the_source_has_the_syntax_of_the_oldest_python() -> None:
    oldest = (3, int(PYTHONS[0].partition('.')[2]))
    for file in SOURCES:
        ast.parse(file.read_text(encoding='utf-8'), str(file), feature_version=oldest)


@pytest.mark.parametrize('version', PYTHONS)
def test_the_source_compiles(version: str) -> None:
    python = shutil.which(f'python{version}')
    # pyenv has a shim on the path for versions that are installed but not active.
    if python is None or subprocess.run([python, '-c', ''], capture_output=True, check=False).returncode:
        pytest.skip(f'no python{version} on the path')
    names = '\n'.join(map(str, SOURCES))
    ran = subprocess.run(
        [python, '-W', 'error', '-c', COMPILE], input=names, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
