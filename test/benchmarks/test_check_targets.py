"""The targets of the weights that ship, checked on a small evaluation."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import pytest
from check_targets import TARGETS, Outcome, Targets, main, outcomes
from street_evaluation import StreetEvaluation, evaluate_street

from offradar_ros.lab.evaluation.results.file import write_results
from offradar_ros.records import read_record


@pytest.fixture(scope='module')
def evaluation() -> StreetEvaluation:
    return evaluate_street()


def test_targets_are_reached_or_missed(evaluation: StreetEvaluation) -> None:
    results, targets = evaluation.results, read_record(Targets, TARGETS)
    found = {(t.text, t.group, t.spacing): t for t in outcomes(results, targets)}
    assert found['AUROC of U for wrong answers', 'streets', '5'].found > 0.6
    assert found['area under Recall@RR above that of stun', 'all', '5'].reached
    equal = found['Recall@1 at least that of stun', 'all', '15']
    assert equal.reached
    assert equal.wanted == equal.found
    assert {t.target for t in found.values()} == {1, 2, 3, 4, 5}
    rising = found['Recall@RR rises at every step up to 0.5', 'all', '5']
    curve = [recall for _, recall in results.groups['all']['5']['ours'].recall_at_rejection[:6]]
    assert rising.reached == all(b > a or b == 1.0 for a, b in itertools.pairwise(curve))
    assert found['mean U of recorded scans: fog above clean', '', ''].reached
    assert not found['mean U of recorded scans: blocked_50 above clean', '', ''].reached
    assert not list(outcomes(results, dataclasses.replace(targets, method='other')))


def test_a_figure_that_could_not_be_measured_is_not_reached() -> None:
    assert not Outcome(1, 'Recall@1', 'all', '5', 0.9, float('nan')).reached
    assert Outcome(1, 'Recall@1', 'all', '5', 0.9, 0.9).reached
    assert not Outcome(1, 'Recall@1', 'all', '5', 0.9, 0.9, strict=True).reached


def test_the_script_fails_if_a_target_is_missed(
    evaluation: StreetEvaluation, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'results.json'
    write_results(path, evaluation.results)
    assert main([str(path)]) == 1
    shown = capsys.readouterr().out
    assert '| 5 | mean U of recorded scans: fog above clean |  | > 0.500 | 0.600 | reached |' in shown
    assert main([str(tmp_path / 'no')]) == 1
    assert 'expected the results.json' in capsys.readouterr().err
