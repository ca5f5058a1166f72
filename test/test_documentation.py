"""What the README and the shipped parameter file say is what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from offradar_ros.cli.main import app
from offradar_ros.cli.parameters import markdown_table
from offradar_ros.config import Config, load_config, parameters, read_parameters

PROJECT = Path(__file__).resolve().parent.parent
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
    for document in (*PROJECT.glob('*.md'), *(PROJECT / 'bags').glob('*.md'), *(PROJECT / 'benchmarks').glob('*.md')):
        for target in re.findall(r'\]\(([^)#]+)\)', document.read_text(encoding='utf-8')):
            assert (document.parent / target).exists(), f'{document.name}: {target}'
