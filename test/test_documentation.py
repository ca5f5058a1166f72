"""What the README and the shipped parameter file say is what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from offradar_ros.cli.main import app
from offradar_ros.cli.parameters import markdown_table
from offradar_ros.config import Config, load_config, parameters, read_parameters
from offradar_ros.recordings.datasets.registry import LAYOUTS
from offradar_ros.recordings.datasets.splits import read_split

PROJECT = Path(__file__).resolve().parent.parent
FOLDERS = ('bags', 'benchmarks', 'docs')
README = (PROJECT / 'README.md').read_text(encoding='utf-8')


def test_the_parameter_table_is_that_of_the_code() -> None:
    table = README.partition('<!-- parameters')[2].partition('-->\n')[2].partition('<!-- end')[0]
    assert table.strip() == markdown_table()


def test_the_shipped_parameter_file_holds_every_default() -> None:
    path = PROJECT / 'params' / 'offradar.yaml'
    assert load_config(path) == Config()
    assert set(read_parameters(path)) == {leaf.name for leaf in parameters(Config())}


@pytest.mark.parametrize('command', sorted(set(re.findall(r'^\| `offradar (\w+)', README, re.MULTILINE))))
def test_every_command_of_the_readme_exists(command: str) -> None:
    assert CliRunner().invoke(app, [command, '--help']).exit_code == 0


def test_every_link_of_the_documents_leads_somewhere() -> None:
    for document in (*PROJECT.glob('*.md'), *(d for f in FOLDERS for d in (PROJECT / f).glob('*.md'))):
        for target in re.findall(r'\]\(([^)#]+)\)', document.read_text(encoding='utf-8')):
            assert (document.parent / target).exists(), f'{document.name}: {target}'


@pytest.mark.parametrize('name', [path.stem for path in (PROJECT / 'params' / 'splits').glob('*.yaml')])
def test_the_splits_are_documented_by_their_files(name: str) -> None:
    said = (PROJECT / 'docs' / 'datasets.md').read_text(encoding='utf-8')
    assert f'(../params/splits/{name}.yaml)' in said
    for sequence in read_split(name).test:
        assert sequence.removesuffix('-radar-oxford-10k') in said


def test_what_the_document_says_of_the_oxford_split_is_so() -> None:
    said = (PROJECT / 'docs' / 'datasets.md').read_text(encoding='utf-8')
    split = read_split('oxford')
    assert f'the other {len(split.train)} full ones' in said
    assert {circle.radius_m for circle in split.region.circles} == {200.0}
    assert f'| buffer | {split.buffer_m:g} m |' in said


def test_every_layout_is_documented() -> None:
    said = (PROJECT / 'docs' / 'datasets.md').read_text(encoding='utf-8')
    assert all(f'\n| `{name}` | ' in said for name in LAYOUTS)
