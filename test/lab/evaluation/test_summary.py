"""Figures of several pairs against loops."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from street_evaluation import StreetEvaluation

from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.figures import draw_rejection_curves, draw_severity
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.runner import Measured
from offradar_ros.lab.evaluation.summary import describe_uncertainty, summarise
from offradar_ros.lab.evaluation.table import tables


def test_figures_against_a_loop(
    measured_street: Callable[..., Measured], embedded_street: Callable[..., EmbeddedDrive], small_protocol: Protocol
) -> None:
    measured = measured_street('ours', [embedded_street(index, 50) for index in range(3)], small_protocol)
    several, thresholds = [a for a in measured.answers if a.pair.spacing_m == 15.0], measured.thresholds
    figures = summarise(several, small_protocol, thresholds)
    rows = [
        (answers.uncertainties[i], bool(answers.ranks[i] == 0), str(answers.kinds[i]), float(answers.severities[i]))
        for answers in several
        for i in range(50)
        if answers.positive[i]
    ]
    right = [correct for _, correct, _, _ in rows]
    assert figures.recall_at_1.value == pytest.approx(sum(right) / len(rows))
    clean = [correct for _, correct, kind, _ in rows if not kind]
    assert figures.recall_at_1_clean.value == pytest.approx(sum(clean) / len(clean))
    flooded = [correct for _, correct, kind, _ in rows if kind == 'flooded']
    assert figures.recall_at_1_by_kind['flooded'] == pytest.approx(sum(flooded) / len(flooded))
    for column, found in ((0, figures.auroc_wrong.value), (3, figures.auroc_wrong_by_severity)):
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
    assert figures.auroc_wrong_by_other_maps == pytest.approx(higher / len(of_wrong) / len(of_right))
    kept = sorted(rows)[: len(rows) // 2]
    assert dict(figures.recall_at_rejection)[0.5] == pytest.approx(np.mean([c for _, c, _, _ in kept]))
    worst = [correct for _, correct, _, severity in rows if severity > 0.75]
    assert dataclasses.astuple(figures.recall_at_1_by_severity[-1]) == (
        0.75,
        1.0,
        len(worst),
        pytest.approx(np.mean(worst)),
    )
    nearest = [
        (answers.distances[i], answers.ranks[i] == 0) for answers in several for i in range(50) if answers.positive[i]
    ]
    before, area = 0, 0.0
    for threshold in sorted({distance for distance, _ in nearest}):
        accepted = [correct for distance, correct in nearest if distance <= threshold]
        area += (sum(accepted) - before) / len(nearest) * float(np.mean(accepted))
        before = sum(accepted)
    assert figures.average_precision.value == pytest.approx(area)
    for beta, best in figures.max_f_beta.items():
        accepted = [correct for distance, correct in nearest if distance <= best.distance]
        precision, recall, square = np.mean(accepted), sum(accepted) / len(nearest), float(beta) ** 2
        assert best.value == pytest.approx((1 + square) * precision * recall / (square * precision + recall))
    # F1 is at most the harmonic mean of F0.5 and F2 where each has its own threshold, and just that at one threshold.
    best = {beta: found.value for beta, found in figures.max_f_beta.items()}
    assert 1.0 / best['1'] >= (1.0 / best['0.5'] + 1.0 / best['2']) / 2.0
    deployed = figures.at_deployed_threshold
    assert deployed is not None
    assert 1.0 / deployed.f_beta['1'] == pytest.approx(
        (1.0 / deployed.f_beta['0.5'] + 1.0 / deployed.f_beta['2']) / 2.0
    )
    answered = [correct for u, correct, _, _ in rows if u <= thresholds.deployed]
    assert deployed.kept == len(answered)
    assert deployed.recall_at_1 == pytest.approx(np.mean(answered))
    precision, recall = float(np.mean(answered)), sum(answered) / len(rows)
    assert deployed.f_beta['2'] == pytest.approx(5.0 * precision * recall / (4.0 * precision + recall))
    for static, row in zip(thresholds.static, figures.recall_at_threshold, strict=True):
        kept = [correct for u, correct, _, _ in rows if u <= static]
        assert (row.threshold, row.kept) == (static, len(kept))
        assert row.rejected == pytest.approx(1.0 - len(kept) / len(rows))
        assert np.array_equal(row.recall_at_1, np.mean(kept) if kept else math.nan, equal_nan=True)
    assert 0.0 <= figures.ause <= figures.ausc.value <= 1.0
    assert 0.0 <= figures.ece <= 1.0
    assert figures.recall_at_5.value == pytest.approx(np.mean([r < 5 for a in several for r in a.ranks[a.positive]]))
    assert figures.recall_at_1.low <= figures.recall_at_1.value <= figures.recall_at_1.high
    assert figures.recall_at_1.pairs == pytest.approx(
        np.mean([np.mean(a.correct[a.positive]) for a in several]),
    )


def test_every_scan_counts_once_for_what_u_follows(
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


def test_tables_and_pictures_can_be_drawn(
    street_evaluation: StreetEvaluation, small_protocol: Protocol, tmp_path: Path
) -> None:
    answers = [answers for m in street_evaluation.measured for answers in m.answers]
    assert len(list(tables(street_evaluation.results))) == 2 + 2
    pytest.importorskip('matplotlib')
    draw_rejection_curves(answers, small_protocol, tmp_path / 'curves.png')
    draw_severity(answers[:6], tmp_path / 'severity.png')
    assert {path.read_bytes()[:4] for path in tmp_path.glob('*.png')} == {b'\x89PNG'}
