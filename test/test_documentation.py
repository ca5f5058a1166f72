"""Documents and the shipped parameter file agree with the code."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest
import typer
from typer.testing import CliRunner

import offradar_ros
from offradar_ros.cli.main import COMMANDS, app
from offradar_ros.cli.parameters import markdown_table
from offradar_ros.config import Config, load_config, parameters, read_parameters
from offradar_ros.encoders.learned import RUNTIMES
from offradar_ros.encoders.registry import ENCODERS
from offradar_ros.recordings.datasets.registry import LAYOUTS
from offradar_ros.recordings.datasets.splits import read_split

PROJECT = Path(__file__).resolve().parent.parent
FOLDERS = ('', 'bags', 'benchmarks', 'docs', 'docs/results')
DOCUMENTS = [document for folder in FOLDERS for document in sorted((PROJECT / folder).glob('*.md'))]


def text_of(name: str) -> str:
    return (PROJECT / name).read_text(encoding='utf-8')


def blocks(text: str) -> list[str]:
    """The code of every fenced block; continued lines are joined."""
    return [block.replace('\\\n', ' ') for block in re.findall(r'^```\w*\n(.*?)^```', text, re.MULTILINE | re.DOTALL)]


def anchors(document: Path) -> set[str]:
    """The anchors of the headings of a document."""
    headings = re.findall(r'^#+ (.+)$', document.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


def commands_in(text: str) -> Iterator[tuple[str, list[str]]]:
    """Each `offradar COMMAND` of the code blocks, with its options."""
    for block in blocks(text):
        for name, rest in re.findall(r'\boffradar ([a-z]\w+)\b([^\n#;|]*)', block):
            yield name, re.findall(r'(?<!\S)--[a-z][\w-]*', rest)


def options_of(command: str) -> set[str]:
    found: Any = typer.main.get_command(app)
    known = found.get_command(None, command)
    return {option for parameter in known.params for option in (*parameter.opts, *parameter.secondary_opts)}


def test_the_readme_is_short() -> None:
    assert len(text_of('README.md').splitlines()) <= 130


def test_the_parameter_table_is_that_of_the_code() -> None:
    table = text_of('docs/nodes.md').partition('<!-- parameters')[2].partition('-->\n')[2].partition('<!-- end')[0]
    assert table.strip() == markdown_table()


def test_the_shipped_parameter_file_holds_every_default() -> None:
    path = PROJECT / 'params' / 'offradar.yaml'
    assert load_config(path) == Config()
    assert set(read_parameters(path)) == {leaf.name for leaf in parameters(Config())}


def test_every_command_is_documented() -> None:
    assert set(re.findall(r'^\| `offradar (\w+)', text_of('docs/commands.md'), re.MULTILINE)) == set(COMMANDS)


@pytest.mark.parametrize('command', COMMANDS)
def test_every_command_has_a_help_text(command: str) -> None:
    assert CliRunner().invoke(app, [command, '--help']).exit_code == 0


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda document: str(document.relative_to(PROJECT)))
def test_every_command_of_a_document_exists_with_its_options(document: Path) -> None:
    for command, options in commands_in(document.read_text(encoding='utf-8')):
        assert command in COMMANDS
        assert set(options) <= options_of(command), command


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda document: str(document.relative_to(PROJECT)))
def test_every_link_of_a_document_leads_somewhere(document: Path) -> None:
    for target, anchor in re.findall(r'\]\(([^)#\s]*)#?([^)\s]*)\)', document.read_text(encoding='utf-8')):
        if not target.startswith('https://'):
            linked = document.parent / target if target else document
            assert linked.exists(), target
            assert not anchor or anchor in anchors(linked), f'{target}#{anchor}'


def test_every_page_is_linked_from_the_readme() -> None:
    linked = re.findall(r'\]\(docs/([\w]+\.md)', text_of('README.md'))
    assert {page.name for page in (PROJECT / 'docs').glob('*.md')} <= set(linked)


def test_every_make_target_of_a_document_exists() -> None:
    targets = set(re.findall(r'^([\w-]+):', text_of('Makefile'), re.MULTILINE))
    for document in DOCUMENTS:
        text = document.read_text(encoding='utf-8')
        named = re.findall(r'`make ([a-z][\w-]*)', text) + re.findall(r'^make ([a-z][\w-]*)', text, re.MULTILINE)
        assert set(named) <= targets, document


def test_every_export_is_documented() -> None:
    page = text_of('docs/python_api.md')
    assert {name for name in offradar_ros.__all__ if f'`{name}`' not in page} == set()


def test_the_python_script_runs_as_it_is_documented(tmp_path: Path, street: Callable[..., Any]) -> None:
    pytest.importorskip('onnxruntime')
    for name, drive in (('monday', street(count=20)), ('tuesday', street(count=10, lane_m=1.0, noise_seed=1))):
        (tmp_path / name).mkdir()
        for index, stamp_ns in enumerate(drive.stamps_ns.tolist()):
            assert cv2.imwrite(str(tmp_path / name / f'{stamp_ns}.png'), drive.scan(index).power)
        lines = [f'{stamp},{x},{y}\n' for i, stamp in enumerate(drive.stamps_ns) for x, y in (drive.position_m(i),)]
        (tmp_path / f'{name}.csv').write_text(''.join(lines))
    (script,) = [block for block in blocks(text_of('docs/python_api.md')) if 'import' in block]
    command = [sys.executable, '-c', f'import sys; sys.path.insert(0, {str(PROJECT)!r})\n{script}']
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    merged, *answers = ran.stdout.splitlines()
    assert 'monday' in merged
    names = [path.name for path in sorted((tmp_path / 'tuesday').glob('*.png'))]
    assert [answer.partition(': ')[0] for answer in answers] == names
    for index, answer in enumerate(answers):
        x_m, y_m = map(float, re.findall(r'= (-?[\d.]+) m', answer))
        assert abs(x_m - 1.25 * index) <= 10.0
        assert y_m == 0.0


@pytest.mark.parametrize('name', [path.stem for path in (PROJECT / 'params' / 'splits').glob('*.yaml')])
def test_the_splits_are_documented_by_their_files(name: str) -> None:
    page = text_of('docs/datasets.md')
    assert f'(../params/splits/{name}.yaml)' in page
    for sequence in read_split(name).test:
        assert sequence.removesuffix('-radar-oxford-10k') in page


def test_the_oxford_split_is_as_documented() -> None:
    page = text_of('docs/datasets.md')
    split = read_split('oxford')
    assert f'the other {len(split.train)} full ones' in page
    assert {circle.radius_m for circle in split.region.circles} == {200.0}
    assert f'| buffer | {split.buffer_m:g} m |' in page


def test_every_layout_is_documented() -> None:
    page = text_of('docs/datasets.md')
    assert all(f'\n| `{name}` | ' in page for name in LAYOUTS)


def test_every_encoder_is_documented() -> None:
    page = text_of('docs/encoders.md')
    rows = re.findall(r'^\| `(\w+)` \| ([\w -]+) \| (yes|no) \|', page, re.MULTILINE)
    assert rows == [(name, entry.title, 'yes' if entry.needs_weights else 'no') for name, entry in ENCODERS.items()]
    assert re.findall(r'^\| `(\w+)` \| `\.\w+` \|', page, re.MULTILINE) == list(RUNTIMES)
