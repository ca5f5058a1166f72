"""Figures of several pairs against loops, and what targets and cards make of them."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.answers import Pair, Rules, answers_from
from offradar_ros.lab.evaluation.card import card_json, card_markdown
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.figures import draw_rejection_curves, draw_severity
from offradar_ros.lab.evaluation.maintenance import ablate, merges
from offradar_ros.lab.evaluation.protocol import Protocol, Validation
from offradar_ros.lab.evaluation.results import SCANS, assemble, read_results, scan_rows, write_results
from offradar_ros.lab.evaluation.runner import Measured
from offradar_ros.lab.evaluation.summary import describe_uncertainty, summarise
from offradar_ros.lab.evaluation.table import tables
from offradar_ros.lab.evaluation.targets import recorded_targets, targets
from offradar_ros.lab.evaluation.thresholds import thresholds_from

THRESHOLDS = thresholds_from([0.3, 0.35, 0.4], Validation((8,), levels=7))
CARD_KEYS = {
    'recall_at_1',
    'recall_at_1_clean',
    'auroc_wrong',
    'auc_recall_at_rejection',
    'recall_at_rejection',
    'spearman_severity',
    'map_maintenance',
    'worlds',
    'seeds',
    'command',
}


def measured(name: str, drives: list[EmbeddedDrive], protocol: Protocol) -> Measured:
    found, ablations = [], {}
    for spacing_m in protocol.map_spacings_m:
        for a, b in itertools.permutations(drives, 2):
            pair = Pair(name, 'streets', 'street', a.drive.index, b.drive.index, spacing_m)
            found.append(answers_from(pair, a, b, Rules()))
        by_pair = {(a.pair.map_index, a.pair.query_index): a for a in found if a.pair.spacing_m == spacing_m}
        ablations['streets', spacing_m] = [
            ablate(by_pair[m.drive.index, q.drive.index], m, between, q, protocol.maintenance, Rules(), 0)
            for m, between, q in merges(drives)
        ]
    info = ModelInfo(name, name * 8, 24, {'settings': '{}'})
    return Measured(name, f'runs/{name}.safetensors', False, info, found, ablations, THRESHOLDS, {})


@pytest.fixture(scope='module')
def results(embedded_street: Callable[..., EmbeddedDrive], small_protocol: Protocol) -> dict:
    ours = [embedded_street(index, 60) for index in range(3)]
    # STUN's U says nothing, its descriptors are alike.
    rng = np.random.default_rng(0)
    stun = [dataclasses.replace(drive, uncertainties=rng.random(60)) for drive in ours]
    several = [measured('ours', ours, small_protocol), measured('stun', stun, small_protocol)]
    told = assemble(several, {}, small_protocol, 'offradar evaluate …', ['kaist: not given'])
    told['targets'] = targets(told)
    told['pairs'] = []
    told['answers'] = [answers for m in several for answers in m.answers]
    told['measured'] = several
    told['worlds_driven'] = {('streets', 'street'): [drive.drive for drive in ours]}
    return told


def test_figures_against_a_loop(embedded_street: Callable[..., EmbeddedDrive], small_protocol: Protocol) -> None:
    several = measured('ours', [embedded_street(index, 50) for index in range(3)], small_protocol).answers
    several = [answers for answers in several if answers.pair.spacing_m == 15.0]
    told = summarise(several, small_protocol, THRESHOLDS)
    rows = [
        (answers.uncertainties[i], bool(answers.ranks[i] == 0), str(answers.kinds[i]), float(answers.severities[i]))
        for answers in several
        for i in range(50)
        if answers.positive[i]
    ]
    right = [correct for _, correct, _, _ in rows]
    assert told['recall_at_1']['value'] == pytest.approx(sum(right) / len(rows))
    clean = [correct for _, correct, kind, _ in rows if not kind]
    assert told['recall_at_1_clean']['value'] == pytest.approx(sum(clean) / len(clean))
    flooded = [correct for _, correct, kind, _ in rows if kind == 'flooded']
    assert told['recall_at_1_by_kind']['flooded'] == pytest.approx(sum(flooded) / len(flooded))
    for column, found in ((0, told['auroc_wrong']['value']), (3, told['auroc_wrong_by_severity'])):
        of_wrong, of_right = [row[column] for row in rows if not row[1]], [row[column] for row in rows if row[1]]
        higher = sum((w > r) + 0.5 * (w == r) for w in of_wrong for r in of_right)
        assert found == pytest.approx(higher / len(of_wrong) / len(of_right))
    elsewhere = [
        (sum(other.ranks[i] != 0 for other in others) / len(others), bool(answers.ranks[i] != 0))
        for answers in several
        for i in range(50)
        if answers.positive[i]
        and (
            others := [
                other
                for other in several
                if other is not answers and other.pair.query_index == answers.pair.query_index and other.positive[i]
            ]
        )
    ]
    of_wrong, of_right = ([share for share, wrong in elsewhere if wrong is so] for so in (True, False))
    higher = sum((w > r) + 0.5 * (w == r) for w in of_wrong for r in of_right)
    assert told['auroc_wrong_by_other_maps'] == pytest.approx(higher / len(of_wrong) / len(of_right))
    kept = sorted(rows)[: len(rows) // 2]
    assert dict(map(tuple, told['recall_at_rejection']))[0.5] == pytest.approx(np.mean([c for _, c, _, _ in kept]))
    worst = [correct for _, correct, _, severity in rows if severity > 0.75]
    assert told['recall_at_1_by_severity'][-1] == {
        'above': 0.75,
        'up_to': 1.0,
        'queries': len(worst),
        'recall_at_1': pytest.approx(np.mean(worst)),
    }
    nearest = [
        (answers.distances[i], answers.ranks[i] == 0) for answers in several for i in range(50) if answers.positive[i]
    ]
    before, area = 0, 0.0
    for threshold in sorted({distance for distance, _ in nearest}):
        accepted = [correct for distance, correct in nearest if distance <= threshold]
        area += (sum(accepted) - before) / len(nearest) * float(np.mean(accepted))
        before = sum(accepted)
    assert told['average_precision']['value'] == pytest.approx(area)
    for beta, best in told['max_f_beta'].items():
        accepted = [correct for distance, correct in nearest if distance <= best['distance']]
        precision, recall, square = np.mean(accepted), sum(accepted) / len(nearest), float(beta) ** 2
        assert best['value'] == pytest.approx((1 + square) * precision * recall / (square * precision + recall))
    # F1 is at most the harmonic mean of F0.5 and F2 where each has its own threshold, and just that at one threshold.
    best = {beta: found['value'] for beta, found in told['max_f_beta'].items()}
    assert 1.0 / best['1'] >= (1.0 / best['0.5'] + 1.0 / best['2']) / 2.0
    deployed = told['at_deployed_threshold']
    assert 1.0 / deployed['f_beta']['1'] == pytest.approx(
        (1.0 / deployed['f_beta']['0.5'] + 1.0 / deployed['f_beta']['2']) / 2.0
    )
    answered = [correct for u, correct, _, _ in rows if u <= THRESHOLDS.deployed]
    assert deployed['kept'] == len(answered)
    assert deployed['recall_at_1'] == pytest.approx(np.mean(answered))
    precision, recall = float(np.mean(answered)), sum(answered) / len(rows)
    assert deployed['f_beta']['2'] == pytest.approx(5.0 * precision * recall / (4.0 * precision + recall))
    for static, row in zip(THRESHOLDS.static, told['recall_at_threshold'], strict=True):
        kept = [correct for u, correct, _, _ in rows if u <= static]
        assert (row['threshold'], row['kept']) == (static, len(kept))
        assert row['rejected'] == pytest.approx(1.0 - len(kept) / len(rows))
        assert np.array_equal(row['recall_at_1'], np.mean(kept) if kept else math.nan, equal_nan=True)
    assert 0.0 <= told['ause'] <= told['ausc']['value'] <= 1.0
    assert 0.0 <= told['ece'] <= 1.0
    assert told['recall_at_5']['value'] == pytest.approx(np.mean([r < 5 for a in several for r in a.ranks[a.positive]]))
    assert told['recall_at_1']['low'] <= told['recall_at_1']['value'] <= told['recall_at_1']['high']
    assert told['recall_at_1']['pairs'] == pytest.approx(
        np.mean([np.mean(a.correct[a.positive]) for a in several]),
    )


def test_every_scan_counts_once_for_what_u_follows(
    embedded_street: Callable[..., EmbeddedDrive], small_protocol: Protocol
) -> None:
    drives = [embedded_street(index, 50) for index in range(3)]
    told = describe_uncertainty(measured('ours', drives, small_protocol).answers)
    assert told['scans'] == 150
    assert told['spearman_severity']['all'] > 0.6
    assert set(told['spearman_severity']) == {'all', 'blocked', 'flooded'}
    every = np.concatenate([drive.uncertainties for drive in drives])
    assert told['mean'] == pytest.approx(every.mean())
    assert told['mean_by_kind']['clean'] < told['mean_by_kind']['blocked']


def test_targets_name_what_is_reached_and_what_is_not(results: dict) -> None:
    told = {(t['text'], t['group'], t['spacing_m']): t for t in results['targets']}
    assert told['AUROC of U for wrong answers', 'streets', '5']['found'] > 0.6
    assert told['area under Recall@RR above that of stun', 'all', '5']['passed']
    equal = told['Recall@1 at least that of stun', 'all', '15']
    assert equal['passed']
    assert equal['wanted'] == f'≥ {equal["found"]:.3f}'
    assert {t['target'] for t in results['targets']} == {1, 2, 3, 4}
    rising = told['Recall@RR rises at every step of 0.1 up to 0.5', 'all', '5']
    curve = [recall for _, recall in results['groups']['all']['5']['ours']['recall_at_rejection'][:6]]
    assert rising['passed'] == all(b > a or b == 1.0 for a, b in itertools.pairwise(curve))


def test_recorded_scans_have_to_be_more_uncertain_than_clean_ones() -> None:
    recorded = {'ours': {'clean': {'mean': 0.5}, 'fog': {'mean': 0.6}, 'blocked_50': {'mean': 0.4}}}
    assert {t['text'].split(': ')[1]: t['passed'] for t in recorded_targets(recorded)} == {
        'fog above clean': True,
        'blocked_50 above clean': False,
    }


def test_results_are_read_as_written_and_cards_hold_their_numbers(results: dict, tmp_path: Path) -> None:
    path = tmp_path / 'results.json'
    told = {key: value for key, value in results.items() if key not in ('answers', 'measured', 'worlds_driven')}
    write_results(path, told | {'odd': math.nan})
    told = read_results(path)
    assert told['odd'] is None
    assert told['groups'] == results['groups']
    figures = card_json(told)
    assert set(figures) == CARD_KEYS
    assert set(figures['recall_at_1']) == {'ours', 'stun'}
    assert figures['recall_at_1']['ours'] == results['groups']['all']['5']['ours']['recall_at_1']['value']
    assert figures['recall_at_rejection']['stun'][0] == [0.0, figures['recall_at_1']['stun']]
    assert set(figures['map_maintenance']) == {'O', 'M', 'M_random', 'Q', 'QM'}
    weights = tmp_path / 'ours.safetensors'
    weights.write_bytes(b'weights')
    (tmp_path / 'config.yaml').write_text('method: variational\n')
    text = card_markdown('compact', told, weights, 'ours' * 8, tmp_path)
    for wanted in (
        f'{figures["recall_at_1"]["ours"]:.3f}',
        'offradar evaluate …',
        'kaist: not given',
        '0.399',
        'simul',
    ):
        assert wanted in text
    assert 'method: variational' in text
    with pytest.raises(DataError, match='the results are of'):
        card_markdown('compact', told, weights, 'stun' * 8, None)
    with pytest.raises(DataError, match='method ours'):
        without = json.loads(json.dumps(told))
        del without['groups']['all']['5']['ours']
        card_json(without)


def test_only_results_are_read(tmp_path: Path) -> None:
    for content in ('{}', 'no json', '[1]'):
        (tmp_path / 'r.json').write_text(content)
        with pytest.raises(DataError, match=r'expected the results\.json'):
            read_results(tmp_path / 'r.json')


def test_scan_rows_say_whose_they_are(results: dict) -> None:
    several: list[Measured] = results['measured']
    rows, pairs, kinds = scan_rows(several, results['worlds_driven'])
    assert rows.dtype == SCANS
    expected = several[-1].ablations['streets', 15.0][-1].maintained
    last = rows[rows['pair'] == len(pairs) - 1]
    assert pairs[-1] == {**dataclasses.asdict(expected.pair), 'maintained': True}
    assert [kinds[k] for k in last['kind']] == expected.kinds.tolist()
    np.testing.assert_array_equal(last['rank'], expected.ranks)
    first = rows[rows['pair'] == 0]
    assert pairs[0] == {**dataclasses.asdict(several[0].answers[0].pair), 'maintained': False}
    np.testing.assert_array_equal(first['distance'], several[0].answers[0].distances.astype(np.float32))
    np.testing.assert_array_equal(first['x_m'], 4.0 * np.arange(60))
    assert set(first['y_m']) == {1.0}


def test_tables_and_pictures_can_be_drawn(results: dict, small_protocol: Protocol, tmp_path: Path) -> None:
    assert len(list(tables(results))) == 2 + 2
    pytest.importorskip('matplotlib')
    draw_rejection_curves(results['answers'], small_protocol, tmp_path / 'curves.png')
    draw_severity(results['answers'][:6], tmp_path / 'severity.png')
    assert {path.read_bytes()[:4] for path in tmp_path.glob('*.png')} == {b'\x89PNG'}
