"""`offradar card`, from results and from a card."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from street_evaluation import evaluate_street

from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.encoders.weights import read_header
from offradar_ros.lab.evaluation.card.file import read_card
from offradar_ros.lab.evaluation.results.file import read_results, write_results


@pytest.fixture(scope='module')
def weights() -> Path:
    return Path(find_weights('compact', ('.safetensors',)))


@pytest.fixture(scope='module')
def results(tmp_path_factory: pytest.TempPathFactory, weights: Path) -> Path:
    """Results of a small evaluation, with the fingerprint of the shipped weights."""
    found = evaluate_street().results
    ours = dataclasses.replace(found.methods['ours'], fingerprint=read_header(weights).fingerprint)
    path = tmp_path_factory.mktemp('evaluation') / 'results.json'
    write_results(path, dataclasses.replace(found, methods={**found.methods, 'ours': ours}))
    return path


def test_a_card_is_made_of_results_weights_and_remarks(
    results: Path, weights: Path, tmp_path: Path, done: Callable[..., str]
) -> None:
    (tmp_path / 'remarks.md').write_text('## Limits\n\nA street alone.\n')
    out = tmp_path / 'mine.card.json'
    named = ['--weights', weights, '--remarks', tmp_path / 'remarks.md', '--out', out]
    assert f'{out} and {tmp_path / "mine.md"}: written' in done('card', results, *named)
    text = (tmp_path / 'mine.md').read_text()
    assert text.startswith('# mine\n')
    assert '## Limits\n\nA street alone.\n\n## Data' in text
    card = read_card(out)
    assert (card.weights.file, card.training) == ('compact.safetensors', '')
    (tmp_path / 'remarks.md').write_text('Other remarks.')
    done('card', out, '--remarks', tmp_path / 'remarks.md')
    assert (tmp_path / 'mine.md').read_text() == text.replace('## Limits\n\nA street alone.', 'Other remarks.')


def test_the_shipped_card_gives_the_shipped_page(weights: Path, tmp_path: Path, done: Callable[..., str]) -> None:
    shutil.copy(weights.with_name('compact.card.json'), tmp_path)
    done('card', tmp_path / 'compact.card.json')
    for name in ('compact.md', 'compact.card.json'):
        assert (tmp_path / name).read_text() == weights.with_name(name).read_text()


def test_missing_options_and_files_are_named(
    results: Path, weights: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    out = tmp_path / 'mine.card.json'
    assert '--weights, --out: expected both' in refused('card', results, '--out', out)
    assert 'expected a name that ends in .card.json' in refused(
        'card', results, '--weights', weights, '--out', tmp_path
    )
    shipped = weights.with_name('compact.card.json')
    assert 'expected only with results' in refused('card', shipped, '--weights', weights, '--out', out)
    gone = ['--weights', weights, '--out', out, '--remarks', tmp_path / 'gone.md']
    assert 'gone.md: expected the remarks of a card' in refused('card', results, *gone)
    assert 'expected the results.json of offradar evaluate' in refused('card', shipped.with_suffix('.no'), *gone[:4])


def test_results_without_ours_are_refused(
    results: Path, weights: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    found = read_results(results)
    without = dataclasses.replace(found, methods={'stun': found.methods['stun']})
    write_results(tmp_path / 'results.json', without)
    options = ['--weights', weights, '--out', tmp_path / 'mine.card.json']
    assert 'expected the method ours' in refused('card', tmp_path / 'results.json', *options)
