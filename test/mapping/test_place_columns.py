"""The growing table against a dictionary of places."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.mapping.place_columns import PlaceColumns, place_of
from offradar_ros.types import Place, PlaceTable, Pose


def make_place(place_id: int, seed: int) -> Place:
    rng = np.random.default_rng(seed)
    mean = rng.normal(size=3).astype(np.float32)
    return Place(place_id, seed, seed * 7, Pose(*rng.normal(size=4)), float(np.float32(rng.random())), mean)


step = st.one_of(
    st.tuples(st.just('upsert'), st.lists(st.integers(0, 40), max_size=25)),
    st.tuples(st.just('remove'), st.lists(st.integers(0, 40), max_size=10)),
)


@settings(max_examples=80, deadline=None)
@given(st.lists(step, max_size=8))
def test_upsert_and_remove_like_a_dictionary(steps: list[tuple[str, list[int]]]) -> None:
    columns = PlaceColumns(3)
    expected: dict[int, Place] = {}
    for number, (verb, ids) in enumerate(steps):
        if verb == 'upsert':
            places = [make_place(place_id, 100 * number + i) for i, place_id in enumerate(ids)]
            columns.upsert(PlaceTable.from_places(places, 3))
            expected.update({place.place_id: place for place in places})
        else:
            columns.remove(np.array(ids, np.int64))
            for place_id in ids:
                expected.pop(place_id, None)
        table = columns.table
        assert table.place_ids.tolist() == sorted(expected)
        for row, place_id in enumerate(sorted(expected)):
            held, wanted = place_of(table, row), expected[place_id]
            assert (held.session_id, held.stamp_ns, held.pose) == (wanted.session_id, wanted.stamp_ns, wanted.pose)
            assert held.uncertainty == wanted.uncertainty
            np.testing.assert_array_equal(held.mean, wanted.mean)


def test_find_distinguishes_known_and_unknown_ids() -> None:
    columns = PlaceColumns(3)
    assert columns.find(np.array([4]))[1].tolist() == [False]
    columns.upsert(PlaceTable.from_places([make_place(4, 1), make_place(9, 2)], 3))
    rows, known = columns.find(np.array([9, 5, 4, 100]))
    assert known.tolist() == [True, False, True, False]
    assert rows[known].tolist() == [1, 0]
