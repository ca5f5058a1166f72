"""`offradar evaluate` and `offradar card`, from a protocol to files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from offradar_ros.cli.main import app
from offradar_ros.errors import ConfigError, DataError

PROTOCOL = """
name: tiny
title: Two tiny cities
groups:
  - {name: a, title: A, physics: drawn, cities: [2999991], streets: [
      {name: toy, map: toy.yaml, traversals: [a.tum, b.tum], seed: 2999993}]}
lanes: [{}, {left_m: 1.0}, {left_m: -1.0}]
scans: 4
validation: {cities: [2999992], scans: 3}
resamples: 5
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('evaluate')
    (folder / 'tiny.yaml').write_text(PROTOCOL)
    return folder


def evaluate(folder: Path, out: str, *more: str) -> str:
    command = ['evaluate', str(folder / 'tiny.yaml'), '--method', 'ring_key', '--out', str(folder / out)]
    done = CliRunner().invoke(
        app, [*command, '--cache', str(folder / 'cache'), '--processes', '2', *more], catch_exceptions=False
    )
    assert done.exit_code == 0
    return done.stdout


def test_an_evaluation_is_repeated_from_its_cache(folder: Path) -> None:
    pytest.importorskip('matplotlib')
    said = evaluate(folder, 'first')
    assert 'toy: maps and traversals are not given' in said
    cached = {path: path.stat().st_mtime_ns for path in (folder / 'cache').rglob('*.*')}
    evaluate(folder, 'second', '--no-pictures')
    assert {path: path.stat().st_mtime_ns for path in (folder / 'cache').rglob('*.*')} == cached
    first, second = (json.loads((folder / out / 'results.json').read_text()) for out in ('first', 'second'))
    assert first['groups'] == second['groups']
    assert first['maintenance'] == second['maintenance']
    assert set(first['groups']) == {'a', 'all'}
    assert first['groups']['a']['5']['ring_key']['pairs'] == 6
    assert first['seeds'] == [2999991, 2999993, 2999992, 0]
    assert (folder / 'first' / 'recall_at_rejection.png').is_file()
    assert (folder / 'first' / 'extremes_ring_key.png').is_file()
    assert not list((folder / 'second').glob('*.png'))


def test_a_card_needs_results_of_ours(folder: Path) -> None:
    evaluate(folder, 'first', '--no-pictures')
    results = str(folder / 'first' / 'results.json')
    runner = CliRunner()
    with pytest.raises(DataError, match='method ours'):
        runner.invoke(
            app,
            ['card', results, '--weights', results, '--out', str(folder / 'x.card.json')],
            catch_exceptions=False,
        )
    with pytest.raises(ConfigError, match=r'\.card\.json'):
        runner.invoke(
            app, ['card', results, '--weights', results, '--out', str(folder / 'x.json')], catch_exceptions=False
        )
