"""What a command reads is never what it replaces, and nothing of another kind is replaced at all."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

RING_KEY = 'encoder:\n  name: ring_key\n'


@pytest.fixture
def place(tmp_path: Path, street_bag: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a bag, parameters and a map."""
    street_bag('bag', count=4)
    (tmp_path / 'car.yaml').write_text(RING_KEY)
    with sqlite3.connect(tmp_path / 'town.db') as database:
        database.execute('CREATE TABLE places (id INTEGER)')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob('*') if path.is_file()}


@pytest.mark.parametrize(
    'arguments',
    [
        'drive bag/bag.mcap --params car.yaml --out bag/bag.mcap',
        'drive bag --params car.yaml --out car.yaml',
        'drive bag --params car.yaml --map town.db --out town.db',
        'drive bag --params car.yaml --map town.db --out linked.db',
        'convert bag bag --overwrite',
        'convert bag bag/again',
        'convert bag/inner bag --overwrite',
    ],
)
def test_an_output_that_is_an_input_is_refused(refused: Callable[..., str], place: Path, arguments: str) -> None:
    (place / 'linked.db').symlink_to('town.db')
    shutil.copytree(place / 'bag', place / 'copy')
    (place / 'copy').rename(place / 'bag' / 'inner')
    before = contents(place)
    text = refused(*arguments.split())
    assert 'and would replace it' in text or 'lies in the source' in text
    assert contents(place) == before


@pytest.mark.parametrize(
    ('arguments', 'kind'),
    [
        ('drive bag --params car.yaml --out town.db', 'a SQLite database'),
        ('drive bag --params car.yaml --out bag/bag.mcap', 'an MCAP recording'),
        ('calibrate bag --params car.yaml --out town.db', 'a SQLite database'),
        ('parameters --out town.db', 'a SQLite database'),
    ],
)
def test_a_file_of_another_kind_is_not_replaced(
    refused: Callable[..., str], place: Path, arguments: str, kind: str
) -> None:
    before = contents(place)
    text = refused(*arguments.split())
    assert f'Holds {kind}' in text
    assert 'give another name' in text
    assert contents(place) == before


def test_calibrate_may_write_the_parameters_that_it_was_given(done: Callable[..., str], place: Path) -> None:
    assert 'car.yaml: replaced' in done('calibrate', 'bag', '--params', 'car.yaml', '--out', 'car.yaml')
    assert 'ring_key' in (place / 'car.yaml').read_text()
