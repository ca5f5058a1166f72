"""Figures over several pairs against loops."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from street_evaluation import StreetEvaluation

from offradar_ros.lab.evaluation.answers import Answers
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.plots import draw_rejection_curves, draw_severity
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.runner import Measured
from offradar_ros.lab.evaluation.summary import describe_uncertainty, summarise
from offradar_ros.lab.evaluation.table import tables
from offradar_ros.lab.evaluation.thresholds import Thresholds

SCANS = 50


class Query(NamedTuple):
    """A query that has a positive."""

    uncertainty: float
    correct: bool
    kind: str
    severity: float
    distance: float
    rank: int


class Summarised(NamedTuple):
    """Figures, and what they are computed from."""

    answers: list[Answers]
    thresholds: Thresholds
    figures: SearchFigures
    queries: list[Query]


@pytest.fixture(scope='module')
def summarised(
    measured_street: Callable[..., Measured], embedded_street: Callable[..., EmbeddedDrive], small_protocol: Protocol
) -> Summarised:
    """Three drives, each searched for in the maps of the others, with a place every 15 m."""
    measured = measured_street('ours', [embedded_street(index, SCANS) for index in range(3)], small_protocol)
    several = [answers for answers in measured.answers if answers.pair.spacing_m == 15.0]
    queries = [
        Query(
            float(answers.uncertainties[i]),
            bool(answers.ranks[i] == 0),
            str(answers.kinds[i]),
            float(answers.severities[i]),
            float(answers.distances[i]),
            int(answers.ranks[i]),
        )
        for answers in several
        for i in range(SCANS)
        if answers.positive[i]
    ]
    figures = summarise(several, small_protocol, measured.thresholds, measured.gate)
    return Summarised(several, measured.thresholds, figures, queries)


def mean_correct(queries: list[Query]) -> float:
    return float(np.mean([query.correct for query in queries]))


def slow_auroc(scores_of_wrong: list[float], scores_of_correct: list[float]) -> float:
    higher = sum((w > c) + 0.5 * (w == c) for w in scores_of_wrong for c in scores_of_correct)
    return higher / len(scores_of_wrong) / len(scores_of_correct)


def f_beta(precision: float, recall: float, beta: float) -> float:
    return (1 + beta**2) * precision * recall / (beta**2 * precision + recall)


def test_recall_against_a_loop(summarised: Summarised) -> None:
    answers, _, figures, queries = summarised
    assert figures.recall_at_1.value == pytest.approx(mean_correct(queries))
    assert figures.recall_at_5.value == pytest.approx(np.mean([query.rank < 5 for query in queries]))
    assert figures.recall_at_1.low <= figures.recall_at_1.value <= figures.recall_at_1.high
    assert figures.recall_at_1.pairs == pytest.approx(np.mean([np.mean(a.correct[a.positive]) for a in answers]))


def test_recall_by_degradation_against_a_loop(summarised: Summarised) -> None:
    figures, queries = summarised.figures, summarised.queries
    clean = [query for query in queries if not query.kind]
    assert figures.recall_at_1_clean.value == pytest.approx(mean_correct(clean))
    flooded = [query for query in queries if query.kind == 'flooded']
    assert figures.recall_at_1_by_kind['flooded'] == pytest.approx(mean_correct(flooded))
    worst = [query for query in queries if query.severity > 0.75]
    highest = figures.recall_at_1_by_severity[-1]
    assert (highest.above, highest.up_to, highest.queries) == (0.75, 1.0, len(worst))
    assert highest.recall_at_1 == pytest.approx(mean_correct(worst))


def test_the_detection_of_wrong_answers_against_a_loop(summarised: Summarised) -> None:
    answers, _, figures, queries = summarised
    wrong, correct = ([query for query in queries if query.correct is value] for value in (False, True))
    assert figures.auroc_wrong.value == pytest.approx(
        slow_auroc([query.uncertainty for query in wrong], [query.uncertainty for query in correct])
    )
    assert figures.auroc_wrong_by_severity == pytest.approx(
        slow_auroc([query.severity for query in wrong], [query.severity for query in correct])
    )
    # The share of the other maps in which the same scan is answered wrongly.
    shares: dict[bool, list[float]] = {False: [], True: []}
    for searched in answers:
        others = [a for a in answers if a is not searched and a.pair.query_index == searched.pair.query_index]
        for i in np.flatnonzero(searched.positive).tolist():
            ranks = [other.ranks[i] for other in others if other.positive[i]]
            if ranks:
                shares[bool(searched.ranks[i] == 0)].append(float(np.mean([rank != 0 for rank in ranks])))
    assert figures.auroc_wrong_by_other_maps == pytest.approx(slow_auroc(shares[False], shares[True]))


def test_recall_at_rejection_against_a_loop(summarised: Summarised) -> None:
    figures, queries = summarised.figures, summarised.queries
    kept = sorted(queries)[: len(queries) // 2]
    assert dict(figures.recall_at_rejection)[0.5] == pytest.approx(mean_correct(kept))
    assert 0.0 <= figures.ause <= figures.ausc.value <= 1.0
    assert 0.0 <= figures.ece <= 1.0


def test_precision_and_recall_against_a_loop(summarised: Summarised) -> None:
    figures, queries = summarised.figures, summarised.queries
    before, area = 0, 0.0
    for threshold in sorted({query.distance for query in queries}):
        accepted = [query for query in queries if query.distance <= threshold]
        correct = sum(query.correct for query in accepted)
        area += (correct - before) / len(queries) * mean_correct(accepted)
        before = correct
    assert figures.average_precision.value == pytest.approx(area)
    for beta, best in figures.max_f_beta.items():
        accepted = [query for query in queries if query.distance <= best.distance]
        recall = sum(query.correct for query in accepted) / len(queries)
        assert best.value == pytest.approx(f_beta(mean_correct(accepted), recall, float(beta)))
    # F1 is the harmonic mean of F0.5 and F2 at one threshold, and at most that where each has its own.
    highest = {beta: best.value for beta, best in figures.max_f_beta.items()}
    assert 1.0 / highest['1'] >= (1.0 / highest['0.5'] + 1.0 / highest['2']) / 2.0


def test_figures_at_thresholds_against_a_loop(summarised: Summarised) -> None:
    _, thresholds, figures, queries = summarised
    deployed = figures.at_deployed_threshold
    assert deployed is not None
    answered = [query for query in queries if query.uncertainty <= thresholds.deployed]
    assert deployed.kept == len(answered)
    assert deployed.recall_at_1 == pytest.approx(mean_correct(answered))
    recall = sum(query.correct for query in answered) / len(queries)
    assert set(deployed.f_beta) == {'0.5', '1', '2'}
    for beta, value in deployed.f_beta.items():
        assert value == pytest.approx(f_beta(mean_correct(answered), recall, float(beta)))
    for static, row in zip(thresholds.static, figures.recall_at_threshold, strict=True):
        kept = [query for query in queries if query.uncertainty <= static]
        assert (row.threshold, row.kept) == (static, len(kept))
        assert row.rejected == pytest.approx(1.0 - len(kept) / len(queries))
        assert row.recall_at_1 == pytest.approx(mean_correct(kept) if kept else math.nan, nan_ok=True)


def test_every_scan_counts_once_in_the_distribution_of_u(
    measured_street: Callable[..., Measured], embedded_street: Callable[..., EmbeddedDrive], small_protocol: Protocol
) -> None:
    drives = [embedded_street(index, 50) for index in range(3)]
    figures = describe_uncertainty(measured_street('ours', drives, small_protocol).answers)
    assert figures.scans == 150
    assert figures.spearman_severity['all'] > 0.6
    assert set(figures.spearman_severity) == {'all', 'blocked', 'flooded'}
    every = np.concatenate([drive.uncertainties for drive in drives])
    assert figures.mean == pytest.approx(every.mean())
    assert figures.mean_by_kind['clean'] < figures.mean_by_kind['blocked']


def test_tables_and_plots_are_drawn(
    street_evaluation: StreetEvaluation, small_protocol: Protocol, tmp_path: Path
) -> None:
    answers = [answers for m in street_evaluation.measured for answers in m.answers]
    assert len(list(tables(street_evaluation.results))) == 2 + 2
    pytest.importorskip('matplotlib')
    draw_rejection_curves(answers, small_protocol, tmp_path / 'curves.png')
    draw_severity(answers[:6], tmp_path / 'severity.png')
    assert {path.read_bytes()[:4] for path in tmp_path.glob('*.png')} == {b'\x89PNG'}
