from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from offradar_ros.calibration.reliability import draw_reliability
from offradar_ros.calibration.threshold_choice import choose_threshold
from offradar_ros.calibration.validation_queries import ValidationQueries
from offradar_ros.errors import DataError
from offradar_ros.retrieval.thresholds import static_thresholds


def queries(scans: int, seed: int = 5) -> ValidationQueries:
    """Uncertain scans are often wrong; every tenth is refused."""
    rng = np.random.default_rng(seed)
    uncertainties = rng.uniform(0.5, 1.5, scans)
    wrong = rng.random(scans) < np.where(uncertainties > 1.2, 0.5, 0.005)
    uncertainties[::10], wrong[::10] = np.inf, True
    return ValidationQueries(2, uncertainties, wrong, np.ones(scans, np.bool_), np.arange(scans) // 12)


def test_the_choice_reports_what_a_count_gives() -> None:
    validation = queries(600)
    choice = choose_threshold(validation, static_thresholds(0.5, 10), 0.05, 0.95)
    # Up to 1.2 hardly any answer is wrong; the next threshold lets in a tenth of the scans, half of them wrong.
    assert choice.threshold == pytest.approx(1.2)
    accepted = validation.uncertainties <= choice.threshold
    assert choice.answered == accepted.sum()
    assert choice.wrong == (accepted & validation.wrong).sum()
    share, low, high = choice.rejection
    assert share == pytest.approx(np.mean(~accepted))
    assert low < share < high
    assert choice.chance_of_wrong_answer == (choice.wrong + 1) / 601 <= 0.05
    assert choice.squares == len(set(validation.squares[accepted]))
    assert choice.wrong / choice.answered < choice.error_rate_by_squares < 0.3


@pytest.mark.parametrize('confidence', [0.75, 0.95])
def test_what_passes_keeps_the_bound_of_conformal_risk_control(confidence: float) -> None:
    for scans in (20, 60, 200):
        for wrong in range(scans // 2):
            uncertainties, mistakes = np.full(scans, 1.0), np.arange(scans) < wrong
            validation = ValidationQueries(2, uncertainties, mistakes, ~mistakes, np.zeros(scans, np.int64))
            try:
                choice = choose_threshold(validation, static_thresholds(0.5, 1), 0.2, confidence)
            except DataError:
                break
            assert choice.chance_of_wrong_answer <= 0.2
        assert wrong > 0


def test_too_few_scans_and_too_many_errors_have_different_messages() -> None:
    thresholds = static_thresholds(0.5, 10)
    with pytest.raises(DataError, match='expected at least 59 scans that can be answered, got 45'):
        choose_threshold(queries(50), thresholds, 0.05, 0.95)
    hopeless = queries(600)
    hopeless.wrong[::2] = True
    with pytest.raises(DataError, match='no threshold is sure') as caught:
        choose_threshold(hopeless, thresholds, 0.05, 0.95)
    found = re.search(r'at best (\d+) of (\d+) answers are wrong, by itself up to (0\.\d+) with', str(caught.value))
    assert found
    wrong, answered, bound = int(found[1]), int(found[2]), float(found[3])
    assert 0.0 < wrong / answered < bound
    # Fewer wrong answers than these have a chance of at most 0.05 where the bound is the rate.
    scipy_stats = pytest.importorskip('scipy.stats')
    assert scipy_stats.binom.cdf(wrong, answered, bound) == pytest.approx(0.05, abs=0.002)


def test_it_is_drawn(tmp_path: Path) -> None:
    cv2 = pytest.importorskip('cv2')
    pytest.importorskip('matplotlib')
    choice = choose_threshold(queries(300), static_thresholds(0.5, 10), 0.1, 0.9)
    draw_reliability(choice, tmp_path / 'drawn.png')
    assert cv2.imread(str(tmp_path / 'drawn.png')).std() > 10.0
