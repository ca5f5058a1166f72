"""Algorithm 1 against a slow second implementation, and properties of the map."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from offradar_ros.config import MapConfig
from offradar_ros.errors import RefusedInput
from offradar_ros.mapping.parent_map import MergeKind, ParentMap
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.types import Embedding, Place, PlaceTable, Pose

DIMENSION = 4

Scan = tuple[float, float, float]
"""U, x and y in metres."""


def scan(stamp: int, uncertainty: float, mean: float = 0.0) -> Embedding:
    return Embedding(
        stamp, np.full(DIMENSION, mean, np.float32), np.full(DIMENSION, uncertainty, np.float32), model='m'
    )


class SlowMap:
    """Algorithm 1 on a list of dictionaries; every distance is computed."""

    def __init__(self, config: MapConfig) -> None:
        self.config = config
        self.entries: list[dict[str, Any]] = []

    def merge(self, stamp: int, uncertainty: float, x: float, y: float, session: int) -> tuple[str, tuple[int, ...]]:
        new = {'stamp': stamp, 'u': float(np.float32(uncertainty)), 'x': x, 'y': y, 'session': session}
        matches = []
        for index, entry in enumerate(self.entries):
            if self.config.match_position == 'anchor':
                distance = math.hypot(x - entry['ax'], y - entry['ay'])
            else:
                distance = math.hypot(x - entry['x'], y - entry['y'])
            if distance < self.config.match_distance_m:
                matches.append((distance, index))
        matches.sort()
        if not matches:
            if self.config.insert_unmatched:
                self.entries.append(new | {'ax': x, 'ay': y})
                return 'inserted', (len(self.entries) - 1,)
            return 'kept', ()
        if self.config.replace == 'nearest':
            matches = matches[:1]
        elif self.config.replace == 'worst':
            worst = max(self.entries[index]['u'] for _, index in matches)
            matches = [next(m for m in matches if self.entries[m[1]]['u'] == worst)]
        replaced = [i for _, i in matches if new['u'] < self.entries[i]['u'] - self.config.replace_margin]
        for index in replaced:
            self.entries[index] |= new
        return ('replaced', tuple(replaced)) if replaced else ('kept', ())


uncertainty = st.sampled_from([0.5, 0.75, 1.0, 1.25, 1.5]) | st.floats(0.0, 3.0)
position = st.floats(0.0, 30.0)
drive = st.lists(st.tuples(uncertainty, position, st.floats(-3.0, 3.0)), max_size=60)


@settings(max_examples=150, deadline=None)
@given(
    drive,
    st.sampled_from(['nearest', 'worst', 'all']),
    st.sampled_from(['anchor', 'pose']),
    st.booleans(),
    st.sampled_from([0.0, 0.25]),
)
def test_merge_equals_the_slow_implementation(
    scans: list[Scan], replace: str, match_position: str, insert: bool, margin: float
) -> None:
    config = MapConfig(replace=replace, match_position=match_position, insert_unmatched=insert, replace_margin=margin)
    fast, slow = ParentMap(config, DIMENSION), SlowMap(config)
    for number, (u, x, y) in enumerate(scans):
        merge = fast.merge(scan(number, u, mean=number), Pose(x, y, 2.0, 0.1), session_id=number // 20)
        kind, ids = slow.merge(number, u, x, y, number // 20)
        assert (merge.kind.value, merge.place_ids) == (kind, ids)
    table = fast.table()
    assert len(fast) == len(slow.entries) == len(table)
    for row, entry in enumerate(slow.entries):
        assert table.place_ids[row] == row
        assert (table.session_ids[row], table.stamps_ns[row]) == (entry['session'], entry['stamp'])
        assert table.positions_m[row].tolist() == [entry['x'], entry['y'], 2.0]
        assert table.uncertainties[row] == np.float32(entry['u'])
        assert table.means[row].tolist() == [entry['stamp']] * DIMENSION
        assert fast.anchors([row]).tolist() == [[entry['ax'], entry['ay']]]


def table_of(scans: list[Scan], first: int = 0) -> PlaceTable:
    """A table of scans with stamps `first`, `first` + 1, …"""
    count = len(scans)
    stamps_ns = first + np.arange(count, dtype=np.int64)
    positions_m = np.array([(x, y, 2.0) for _, x, y in scans], np.float64).reshape(count, 3)
    return PlaceTable(
        place_ids=np.zeros(count, np.int64),
        session_ids=np.zeros(count, np.int32),
        stamps_ns=stamps_ns,
        positions_m=positions_m,
        yaws_rad=np.full(count, 0.1),
        yaw_sds_rad=np.full(count, 0.02, np.float32),
        uncertainties=np.array([u for u, _, _ in scans], np.float32),
        means=np.repeat(stamps_ns[:, None], DIMENSION, axis=1).astype(np.float32),
    )


whole_metres = st.lists(
    st.tuples(uncertainty, st.integers(0, 20).map(float), st.integers(-3, 3).map(float)), max_size=60
)


@settings(max_examples=200, deadline=None)
@given(
    drive | whole_metres,
    drive | whole_metres,
    st.sampled_from(['nearest', 'worst', 'all']),
    st.sampled_from(['anchor', 'pose']),
    st.booleans(),
    st.sampled_from([0.0, 0.25]),
)
def test_merge_all_equals_merge_of_each_scan(
    mapped: list[Scan], merged: list[Scan], replace: str, match_position: str, insert: bool, margin: float
) -> None:
    first = MapConfig(replace=replace, match_position=match_position, replace_margin=margin)
    second = dataclasses.replace(first, insert_unmatched=insert)
    maps = []
    for batched in (True, False):
        parent = ParentMap(first, DIMENSION)
        for config, session_id, scans in ((first, 1, table_of(mapped)), (second, 2, table_of(merged, 100))):
            parent.config = config
            before = [nearest_place(parent, pose) for pose in poses_of(scans)] if not insert else None
            if batched:
                merges = parent.merge_all(scans, session_id)
                kinds = list(merges.kinds)
                if session_id == 2 and before is not None and match_position == 'anchor':
                    assert merges.nearest.tolist() == before
            else:
                kinds = [
                    parent.merge(scan(int(stamp), float(u), float(stamp)), pose, session_id).kind
                    for stamp, u, pose in zip(scans.stamps_ns, scans.uncertainties, poses_of(scans), strict=True)
                ]
        places = parent.table()
        maps.append((kinds, parent.next_place_id, vars_of(places), parent.anchors(places.place_ids.tolist())))
    (kinds, ids, columns, anchors), (slow_kinds, slow_ids, slow_columns, slow_anchors) = maps
    assert (kinds, ids) == (slow_kinds, slow_ids)
    for column, expected in zip(columns, slow_columns, strict=True):
        np.testing.assert_array_equal(column, expected)
    np.testing.assert_array_equal(anchors, slow_anchors)


def poses_of(scans: PlaceTable) -> list[Pose]:
    return [Pose(x, y, z, 0.1, 0.02) for x, y, z in scans.positions_m.tolist()]


def nearest_place(parent: ParentMap, pose: Pose) -> int:
    """Id of the place with the nearest anchor within D_t; −1 if there is none."""
    ids = parent.table().place_ids.tolist()
    distances = [
        (math.hypot(x - pose.x_m, y - pose.y_m), i) for i, (x, y) in zip(ids, parent.anchors(ids), strict=True)
    ]
    return min((pair for pair in distances if pair[0] < 5.0), default=(0.0, -1))[1]


@pytest.mark.parametrize(
    ('column', 'value', 'cause', 'words'),
    [
        ('means', math.nan, 'invalid_embedding', 'embedding at 101 ns: expected a finite mean'),
        ('uncertainties', math.inf, 'invalid_embedding', 'embedding at 101 ns: .*finite U of 0 or more'),
        ('uncertainties', -1.0, 'invalid_embedding', 'embedding at 101 ns'),
        ('positions_m', math.nan, 'invalid_position', 'scan at 101 ns: expected finite metres'),
        ('positions_m', 1e9, 'invalid_position', 'scan at 101 ns'),
    ],
)
def test_one_invalid_scan_of_many_leaves_the_map_unchanged(column: str, value: float, cause: str, words: str) -> None:
    parent = ParentMap(MapConfig(), DIMENSION)
    scans = table_of([(1.0, 0.0, 0.0), (1.0, 9.0, 0.0), (1.0, 18.0, 0.0)], 100)
    getattr(scans, column)[1] = value
    with pytest.raises(RefusedInput, match=words) as refused:
        parent.merge_all(scans, 1)
    assert refused.value.cause == cause
    assert len(parent) == 0
    with pytest.raises(RefusedInput, match=r'expected means of shape \(3, 2\)'):
        ParentMap(MapConfig(), 2).merge_all(table_of([(1.0, 0.0, 0.0)] * 3), 1)


@settings(max_examples=150, deadline=None)
@given(drive, st.sampled_from(['nearest', 'worst', 'all']))
def test_with_anchors_every_merged_position_has_a_scan_within_twice_d_t(scans: list[Scan], replace: str) -> None:
    parent = ParentMap(MapConfig(replace=replace), DIMENSION)
    for number, (u, x, y) in enumerate(scans):
        parent.merge(scan(number, u), Pose(x, y), 1)
    held = parent.table().positions_m[:, :2]
    for _, x, y in scans:
        assert np.hypot(held[:, 0] - x, held[:, 1] - y).min() < 2 * 5.0


def places_after_falling_uncertainty(match_position: str) -> NDArray[np.float64]:
    """Sorted x of the places after 100 m with a scan each metre, each a little more certain than the last."""
    parent = ParentMap(MapConfig(match_position=match_position), DIMENSION)
    for metre in range(100):
        parent.merge(scan(metre, 2.0 - 0.01 * metre), Pose(float(metre), 0.0), 1)
    return np.asarray(np.sort(parent.table().positions_m[:, 0]))


def test_more_certain_scans_move_a_place_along_the_road_unless_it_is_anchored() -> None:
    assert places_after_falling_uncertainty('pose').tolist() == [99.0]
    anchored = places_after_falling_uncertainty('anchor')
    assert anchored[0] < 5.0
    assert np.diff(anchored).max() < 10.0


def test_the_more_certain_scan_stays_in_any_order() -> None:
    for order in ([1.2, 0.8], [0.8, 1.2]):
        parent = ParentMap(MapConfig(), DIMENSION)
        for number, u in enumerate(order):
            parent.merge(scan(number, u), Pose(0.0, 0.0), number)
        assert len(parent) == 1
        assert parent.place(0).uncertainty == np.float32(0.8)


def test_a_replaced_place_keeps_its_id_and_gets_pose_stamp_and_session_of_the_scan() -> None:
    parent = ParentMap(MapConfig(), DIMENSION)
    parent.merge(scan(10, 1.0, mean=1.0), Pose(0.0, 0.0, 1.0, 0.5), 1)
    merge = parent.merge(scan(20, 0.9, mean=2.0), Pose(3.0, 0.0, 2.0, 0.6), 2)
    place = parent.place(0)
    assert (merge.kind, merge.place_ids) == (MergeKind.REPLACED, (0,))
    assert (place.stamp_ns, place.session_id, place.pose) == (20, 2, Pose(3.0, 0.0, 2.0, 0.6))
    assert place.mean.tolist() == [2.0] * DIMENSION
    assert (merge.before[0].stamp_ns, merge.before[0].pose.x_m) == (10, 0.0)


def test_an_equally_certain_scan_changes_nothing() -> None:
    same = Embedding(1, np.zeros(3, np.float32), np.array([0.1, 0.2, 0.4], np.float32))
    parent = ParentMap(MapConfig(), 3)
    parent.merge(same, Pose(0.0, 0.0), 1)
    assert parent.merge(same, Pose(0.0, 0.0), 2).kind is MergeKind.KEPT


def test_altitude_does_not_separate_places() -> None:
    parent = ParentMap(MapConfig(), DIMENSION)
    parent.merge(scan(1, 1.0), Pose(0.0, 0.0, 0.0), 1)
    assert parent.merge(scan(2, 1.0), Pose(0.0, 0.0, 40.0), 2).kind is MergeKind.KEPT


def test_without_insertion_the_map_has_a_constant_size() -> None:
    parent = ParentMap(MapConfig(), DIMENSION)
    for metre in range(0, 50, 10):
        parent.merge(scan(metre, 1.0), Pose(float(metre), 0.0), 1)
    later = ParentMap(MapConfig(insert_unmatched=False), DIMENSION)
    later.load(columns_of(parent.table()), parent.anchors(list(range(5))), parent.next_place_id)
    for metre in range(0, 200, 3):
        later.merge(scan(metre, 0.5), Pose(float(metre), 0.0), 2)
    assert len(later) == 5
    assert later.mean_uncertainty == 0.5


@pytest.mark.parametrize(
    ('embedding', 'words'),
    [
        (Embedding(7, np.zeros(3, np.float32), np.ones(3, np.float32)), 'dimension of the map, 4, got 3'),
        (dataclasses.replace(scan(7, 1.0), mean=np.full(4, np.nan, np.float32)), '4 of 4 values of the mean'),
        (dataclasses.replace(scan(7, 1.0), variance=np.full(4, np.inf, np.float32)), 'values of the variance'),
        (dataclasses.replace(scan(7, 1.0), variance=np.full(4, -1.0, np.float32)), 'negative value, -1'),
        (dataclasses.replace(scan(7, 1.0), variance=np.ones(3, np.float32)), 'one equal length'),
        (Embedding(7, np.zeros(0, np.float32), np.zeros(0, np.float32)), 'one equal length'),
    ],
)
def test_invalid_embeddings_are_refused_and_leave_the_map_unchanged(embedding: Embedding, words: str) -> None:
    parent = ParentMap(MapConfig(), DIMENSION)
    with pytest.raises(RefusedInput, match=words) as refused:
        parent.merge(embedding, Pose(0.0, 0.0), 1)
    assert refused.value.cause == 'invalid_embedding'
    assert '\n' not in str(refused.value) and '7 ns' in str(refused.value)
    assert len(parent) == 0 and math.isnan(parent.mean_uncertainty)


@pytest.mark.parametrize('pose', [Pose(math.nan, 0.0), Pose(0.0, math.inf), Pose(0.0, 0.0, math.nan), Pose(1e300, 0.0)])
def test_positions_that_are_not_on_earth_are_refused(pose: Pose) -> None:
    parent = ParentMap(MapConfig(), DIMENSION)
    with pytest.raises(RefusedInput) as refused:
        parent.merge(scan(1, 1.0), pose, 1)
    assert refused.value.cause == 'invalid_position'


@pytest.mark.parametrize('match_position', ['anchor', 'pose'])
def test_restore_and_remove_undo_a_drive(match_position: str) -> None:
    config = MapConfig(match_position=match_position)
    parent = ParentMap(config, DIMENSION)
    rng = np.random.default_rng(3)
    path = [(rng.uniform(0, 60), rng.uniform(0, 3)) for _ in range(80)]
    for number, (x, y) in enumerate(path[:40]):
        parent.merge(scan(number, rng.uniform(0.5, 1.5)), Pose(x, y), 1)
    first, count = parent.table(), len(parent)
    old: dict[int, Place] = {}
    new: list[int] = []
    for number, (x, y) in enumerate(path[40:]):
        merge = parent.merge(scan(100 + number, rng.uniform(0.0, 1.5)), Pose(x + 30, y), 2)
        new += merge.place_ids if merge.kind is MergeKind.INSERTED else []
        for place in merge.before:
            old.setdefault(place.place_id, place)
    assert old and new
    parent.restore([place for place in old.values() if place.place_id < count])
    parent.remove(new)
    for column, expected in zip(vars_of(parent.table()), vars_of(first), strict=True):
        np.testing.assert_array_equal(column, expected)
    # Later merges also equal those of a map without the second drive.
    fresh = ParentMap(config, DIMENSION)
    fresh.load(columns_of(first), parent.anchors(first.place_ids.tolist()), parent.next_place_id)
    for number, (x, y) in enumerate(path):
        one, other = (m.merge(scan(number, 0.7), Pose(x + 10, y), 3) for m in (parent, fresh))
        assert (one.kind, one.place_ids) == (other.kind, other.place_ids)


def columns_of(table: PlaceTable) -> PlaceColumns:
    columns = PlaceColumns(DIMENSION, len(table))
    columns.upsert(table)
    return columns


def vars_of(table: PlaceTable) -> list[NDArray[Any]]:
    return [getattr(table, field.name) for field in dataclasses.fields(table)]


def test_only_the_newest_places_can_be_removed_and_unknown_ones_are_named() -> None:
    parent = ParentMap(MapConfig(), DIMENSION)
    for metre in (0.0, 10.0, 20.0):
        parent.merge(scan(1, 1.0), Pose(metre, 0.0), 1)
    with pytest.raises(ValueError, match='not the newest'):
        parent.remove([0])
    with pytest.raises(KeyError, match='no place 7'):
        parent.rows([7])
    parent.remove([2, 1])
    assert parent.table().place_ids.tolist() == [0]
    parent.merge(scan(1, 1.0), Pose(10.0, 0.0), 1)
    assert parent.table().place_ids.tolist() == [0, 3]


def test_no_place_is_lost_when_the_memory_grows() -> None:
    parent = ParentMap(MapConfig(), DIMENSION)
    for number in range(1000):
        parent.merge(scan(number, 1.0, mean=number), Pose(6.0 * number, 0.0), 1)
    table = parent.table()
    assert table.means[:, 0].tolist() == list(range(1000))
    assert parent.rows([999, 3]).stamps_ns.tolist() == [999, 3]
