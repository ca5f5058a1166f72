"""Scores for a shortlist, in both ways, within the rounding of single precision."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from offradar_ros.retrieval import mean_storage as storages
from offradar_ros.retrieval.mean_storage import ROUND_OFF, is_precise, mean_storage, scores_in_blocks


def by_llvm(means, query, squares):
    compiled = pytest.importorskip('offradar_ros.retrieval.half_scores')
    return compiled.scores_of_halves(means, query, squares)


WAYS = pytest.mark.parametrize('scores', [by_llvm, scores_in_blocks], ids=['llvm', 'blocks'])
halves = arrays.arrays(np.float16, (3, 5), elements=st.floats(-65504, 65504, width=16))
queries = arrays.arrays(np.float32, 5, elements=st.floats(-(2.0**60), 2.0**60, width=32))
squares_of_three = arrays.arrays(np.float32, 3, elements=st.floats(0.0, 2.0**36, width=32))


@WAYS
@settings(max_examples=200, deadline=None)
@given(means=halves, query=queries, squares=squares_of_three)
def test_scores_of_halves_are_within_their_rounding(scores, means, query, squares):
    found = scores(means, query, squares)
    assert found.dtype == np.float32 and found.shape == (3,)
    for score, square, row in zip(found, squares.astype(np.float64), means.astype(np.float64), strict=True):
        size = 2.0 * np.linalg.norm(row) * np.linalg.norm(query.astype(np.float64)) + square
        assert abs(float(score) - (square - 2.0 * row @ query)) <= 8 * ROUND_OFF * size + 1e-37


@WAYS
@pytest.mark.parametrize('dimension', [1, 31, 128, 1000])
def test_more_rows_than_a_block_and_none(scores, dimension):
    rng = np.random.default_rng(0)
    for count in (2500, 0):
        means = rng.normal(size=(count, dimension)).astype(np.float16)
        query = rng.normal(size=dimension).astype(np.float32)
        squares = rng.normal(size=count).astype(np.float32)
        expected = squares - 2.0 * means.astype(float) @ query
        np.testing.assert_allclose(scores(means, query, squares), expected, rtol=0.0, atol=1e-3)


def test_sums_of_halves_added_as_halves_or_without_the_smallest_are_not_taken_for_precise():
    def coarse(means, query, squares):
        return squares - 2.0 * (means @ query.astype(np.float16)).astype(np.float32)

    def flushing(means, query, squares):
        return scores_in_blocks(np.where(np.abs(means) < 2.0**-14, np.float16(0), means), query, squares)

    assert not is_precise(coarse)
    assert not is_precise(flushing)
    assert is_precise(scores_in_blocks) and is_precise(by_llvm)


@pytest.fixture
def chosen_anew():
    storages._half_scores.cache_clear()
    yield
    storages._half_scores.cache_clear()


@pytest.mark.usefixtures('chosen_anew')
def test_llvm_is_used_where_it_is():
    compiled = pytest.importorskip('offradar_ros.retrieval.half_scores')
    assert mean_storage('float16').scores is compiled.scores_of_halves


@pytest.mark.usefixtures('chosen_anew')
def test_without_llvmlite_blocks_do(monkeypatch):
    monkeypatch.delitem(sys.modules, 'offradar_ros.retrieval.half_scores', raising=False)
    monkeypatch.setitem(sys.modules, 'llvmlite', None)
    assert mean_storage('float16').scores is scores_in_blocks


@pytest.mark.usefixtures('chosen_anew')
def test_on_a_processor_that_cannot_widen_halves_blocks_do(monkeypatch):
    binding = pytest.importorskip('llvmlite.binding')
    monkeypatch.delitem(sys.modules, 'offradar_ros.retrieval.half_scores', raising=False)
    monkeypatch.setattr('platform.machine', lambda: 'x86_64')
    monkeypatch.setattr(binding, 'get_host_cpu_features', dict)
    assert mean_storage('float16').scores is scores_in_blocks


@pytest.mark.usefixtures('chosen_anew')
def test_imprecise_sums_are_not_used(monkeypatch):
    monkeypatch.setattr(storages, 'is_precise', lambda _: False)
    assert mean_storage('float16').scores is scores_in_blocks


@pytest.mark.usefixtures('chosen_anew')
@pytest.mark.parametrize(
    'why', [RuntimeError('LLVM IR parsing error'), OSError('no such library'), TypeError('arguments')]
)
def test_an_llvm_that_cannot_be_used_is_not(monkeypatch, why):
    binding = pytest.importorskip('llvmlite.binding')

    def fail(*_, **__):
        raise why

    monkeypatch.delitem(sys.modules, 'offradar_ros.retrieval.half_scores', raising=False)
    monkeypatch.setattr(binding, 'parse_assembly', fail)
    assert mean_storage('float16').scores is scores_in_blocks


@pytest.mark.parametrize('shape', [(2, 3), (4,), (3, 4)])
def test_a_query_of_another_length_is_not_read_beyond_its_end(shape):
    compiled = pytest.importorskip('offradar_ros.retrieval.half_scores')
    with pytest.raises(ValueError, match='reshape'):
        compiled.scores_of_halves(np.ones((4, 8), np.float16), np.ones(shape, np.float32), np.ones(4, np.float32))
