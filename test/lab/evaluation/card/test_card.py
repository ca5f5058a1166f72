"""Model cards hold the figures of results and the remarks of their author."""

from __future__ import annotations

import dataclasses
import hashlib
import re
from pathlib import Path

import pytest
from street_evaluation import StreetEvaluation, fingerprint_of

from offradar_ros.encoders.weights import read_header
from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.card.card import Card
from offradar_ros.lab.evaluation.card.file import read_card, write_card
from offradar_ros.lab.evaluation.card.make import CardSources, make_card, with_open_set
from offradar_ros.lab.evaluation.card.markdown import card_markdown
from offradar_ros.lab.evaluation.protocol import Group, Protocol, Recorded
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.lab.evaluation.results.ablation import AblationFigures
from offradar_ros.lab.evaluation.results.results import ByMap, Results
from offradar_ros.shipped import shipped_file

SHIPPED = Path(__file__).parents[4] / 'offradar_ros' / 'weights'
REMARKS = Path(__file__).parents[4] / 'benchmarks' / 'model_card' / 'compact.md'


@pytest.fixture
def sources(tmp_path: Path) -> CardSources:
    weights = tmp_path / 'ours.safetensors'
    weights.write_bytes(b'weights')
    (tmp_path / 'config.yaml').write_text('method: variational\n')
    return CardSources('mine', weights, fingerprint_of('ours'), 'offradar card …', '## Limits\n\nOne street.', tmp_path)


@pytest.fixture
def card(street_evaluation: StreetEvaluation, sources: CardSources) -> Card:
    return make_card(street_evaluation.results, sources)


def test_a_card_holds_the_numbers_of_the_results(street_evaluation: StreetEvaluation, card: Card) -> None:
    figures = street_evaluation.results.groups['all']['5']
    assert set(card.recall_at_1) == {'ours', 'stun'}
    assert card.recall_at_1['ours'] == figures['ours'].recall_at_1.value
    assert card.recall_at_rejection['stun'][0] == (0.0, card.recall_at_1['stun'])
    assert set(card.map_maintenance) == {'O', 'M', 'M_random', 'Q', 'QM'}
    text = card_markdown(card)
    for wanted in (
        f'{figures["ours"].recall_at_1.value:.3f} ({figures["ours"].recall_at_1.low:.3f} to ',
        'offradar evaluate …',
        'offradar card …',
        'kaist: not given',
        '0.399',
        'on simulated drives only',
        '35% of the scans of its drives, mapped ones too: blocked, flooded.',
        'sunny',
        '| fog | 11 | 0.600 | 50% |',
        '## Limits\n\nOne street.',
        'method: variational',
    ):
        assert wanted in text


def test_a_card_says_what_is_answered_on_the_map_and_off_it(street_evaluation: StreetEvaluation, card: Card) -> None:
    found = street_evaluation.results.groups['streets']['15']['ours'].open_set
    assert card.open_set['streets']['15'].gate == found.gate
    gate = found.gate
    text = card_markdown(card)
    assert f'| streets, 15 m | {found.on_map} | 0 | p_right 0.900 | {gate.answered_on_map:.3f} |' in text
    assert f'| streets, 15 m | p_right | {found.confidences["p_right"].auroc.value:.3f} (' in text
    assert '## On the map and off it' not in card_markdown(dataclasses.replace(card, open_set={}))


def test_what_is_answered_off_the_map_can_come_from_other_results(
    street_evaluation: StreetEvaluation, card: Card
) -> None:
    results = street_evaluation.results
    halves = dataclasses.replace(results.protocol, leave_out='halves')
    other = dataclasses.replace(results, protocol=halves, command='offradar evaluate held_out_open')
    taken = with_open_set(dataclasses.replace(card, open_set={}), other)
    assert taken.open_set == card.open_set
    assert 'Measured by `offradar evaluate held_out_open`.' in card_markdown(taken)
    with pytest.raises(DataError, match='expected a protocol that leaves out a part of each map'):
        with_open_set(card, results)
    strange = dataclasses.replace(card, weights=dataclasses.replace(card.weights, fingerprint='f' * 64))
    with pytest.raises(DataError, match='expected those of the card, ffffffffffff'):
        with_open_set(strange, other)


def test_a_card_mentions_only_what_was_measured(street_evaluation: StreetEvaluation, sources: CardSources) -> None:
    results = recorded(street_evaluation.results)
    text = card_markdown(make_card(results, dataclasses.replace(sources, remarks='', training=None)))
    assert 'on recorded drives only' in text
    for absent in ('simulat', 'degrade', 'Training', 'Limits', 'safety', 'O | M'):
        assert absent not in text


def recorded(results: Results) -> Results:
    """The same figures as if of two recorded drives: no map is maintained, and the severity of scans is unknown."""
    group = Group('streets', 'A street', recorded=(Recorded('street', maps=('monday',), queries=('tuesday',)),))
    protocol = Protocol('own', 'Own recordings', (group,), map_spacings_m=results.protocol.map_spacings_m)
    uncertainty = {
        name: {method: dataclasses.replace(u, mean_by_kind={'recorded': u.mean}) for method, u in methods.items()}
        for name, methods in results.uncertainty.items()
    }
    nothing: ByMap[AblationFigures] = {
        name: {spacing: {} for spacing in spacings} for name, spacings in results.maintenance.items()
    }
    return dataclasses.replace(
        results, protocol=protocol, uncertainty=uncertainty, maintenance=nothing, recorded=None, skipped=()
    )


def test_a_card_of_other_weights_is_refused(street_evaluation: StreetEvaluation, sources: CardSources) -> None:
    results = street_evaluation.results
    with pytest.raises(DataError, match='the results are of'):
        make_card(results, dataclasses.replace(sources, fingerprint=fingerprint_of('stun')))
    with pytest.raises(DataError, match='method ours'):
        make_card(dataclasses.replace(results, methods={'stun': results.methods['stun']}), sources)


def test_cards_are_read_as_written(card: Card, tmp_path: Path) -> None:
    path = tmp_path / 'mine.card.json'
    assert write_card(path, card).name == 'mine.md'
    found = read_card(path)
    assert repr(found) == repr(card)
    assert (tmp_path / 'mine.md').read_text() == card_markdown(found)
    path.write_text(re.sub('offradar-card-1', 'offradar-card-0', path.read_text()))
    with pytest.raises(DataError, match='make it again from the results'):
        read_card(path)


def test_the_shipped_card_describes_the_shipped_weights_and_protocol() -> None:
    card, weights = read_card(SHIPPED / 'compact.card.json'), SHIPPED / 'compact.safetensors'
    assert card.weights.sha256 == hashlib.sha256(weights.read_bytes()).hexdigest()
    assert card.weights.fingerprint == read_header(weights).fingerprint
    assert card.protocol == read_protocol(shipped_file('protocols', 'held_out'))
    assert card.remarks == REMARKS.read_text().strip()
    assert (SHIPPED / 'compact.md').read_text() == card_markdown(card)
    # The headline figures for programs are those of the tables.
    for method, figures in card.groups['all']['5'].items():
        for name in ('recall_at_1', 'recall_at_1_clean', 'auroc_wrong', 'auc_recall_at_rejection'):
            assert getattr(card, name)[method] == pytest.approx(getattr(figures, name).value, abs=0.0005)
