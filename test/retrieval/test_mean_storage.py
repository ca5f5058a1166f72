"""Products for a shortlist, in both ways, within the bound that they give."""

import sys
import types

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from offradar_ros.retrieval import mean_storage as storages
from offradar_ros.retrieval.mean_storage import ROUND_OFF, is_precise, mean_storage, products_in_blocks


def by_numkong(means, query):
    return storages.products_of_halves(pytest.importorskip('numkong'), means, query)


WAYS = pytest.mark.parametrize('products', [by_numkong, products_in_blocks], ids=['numkong', 'blocks'])
halves = arrays.arrays(np.float16, (3, 5), elements=st.floats(-65504, 65504, width=16))
queries = arrays.arrays(np.float32, 5, elements=st.floats(-(2.0**60), 2.0**60, width=32))


@WAYS
@settings(max_examples=200, deadline=None)
@given(means=halves, query=queries)
def test_products_of_halves_are_within_their_bound(products, means, query):
    found, slack = products(means, query)
    assert found.dtype == np.float32 and found.shape == (3,)
    for product, row in zip(found, means.astype(np.float64), strict=True):
        length = np.linalg.norm(row)
        rounding = 8 * ROUND_OFF * length * np.linalg.norm(query.astype(np.float64)) + 1e-37
        assert abs(float(product) - row @ query) <= rounding + slack * length


@WAYS
def test_more_rows_than_a_block_and_none(products):
    rng = np.random.default_rng(0)
    means = rng.normal(size=(2500, 128)).astype(np.float16)
    query = rng.normal(size=128).astype(np.float32)
    found, slack = products(means, query)
    lengths = np.linalg.norm(means.astype(float), axis=1)
    assert np.all(np.abs(found - means.astype(float) @ query) <= lengths * (slack + 1e-4))


def test_sums_of_halves_added_as_halves_or_without_the_smallest_are_not_taken_for_precise():
    def coarse(means, query):
        return (means @ query.astype(np.float16)).astype(np.float32), 0.0

    def flushing(means, query):
        return products_in_blocks(np.where(np.abs(means) < 2.0**-14, np.float16(0), means), query)

    assert not is_precise(coarse)
    assert not is_precise(flushing)
    assert is_precise(products_in_blocks) and is_precise(by_numkong)


@pytest.fixture
def chosen_anew():
    storages._half_products.cache_clear()
    yield
    storages._half_products.cache_clear()


@pytest.mark.usefixtures('chosen_anew')
def test_without_numkong_blocks_do(monkeypatch):
    monkeypatch.setitem(sys.modules, 'numkong', None)
    assert mean_storage('float16').products is products_in_blocks


@pytest.mark.usefixtures('chosen_anew')
def test_an_imprecise_numkong_is_not_used(monkeypatch):
    monkeypatch.setattr(storages, 'is_precise', lambda _: False)
    assert mean_storage('float16').products is products_in_blocks


def raising(error):
    def raise_it(*_, **__):
        raise error

    return raise_it


@pytest.mark.usefixtures('chosen_anew')
@pytest.mark.parametrize(
    'unusable',
    [
        types.SimpleNamespace(),
        types.SimpleNamespace(dots_pack=lambda: None, dots_packed=lambda: None),
        types.SimpleNamespace(dots_pack=raising(OSError('no such library')), dots_packed=None),
    ],
    ids=['without its functions', 'with other arguments', 'without its library'],
)
def test_a_numkong_that_cannot_be_used_is_not(monkeypatch, unusable):
    monkeypatch.setitem(sys.modules, 'numkong', unusable)
    assert mean_storage('float16').products is products_in_blocks


@pytest.mark.usefixtures('chosen_anew')
def test_a_numkong_whose_library_does_not_load_is_not_used(monkeypatch):
    monkeypatch.setattr(storages.importlib, 'import_module', raising(OSError('cannot open shared object file')))
    assert mean_storage('float16').products is products_in_blocks
