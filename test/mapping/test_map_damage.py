"""A damaged map is refused, or holds exactly what was written; nothing else is ever read."""

from __future__ import annotations

import collections
import contextlib
import os
import random
import shutil
import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from small_maps import (
    MODEL,
    as_version_1,
    as_version_2,
    assert_tables_equal,
    change,
    difference,
    drive,
    folder_state,
    make_map,
    open_map,
    scan,
)

from offradar_ros.errors import MapError
from offradar_ros.mapping.map_reader import ALONE, open_sqlite, read_committed, read_map
from offradar_ros.mapping.place_columns import PlaceColumns
from offradar_ros.mapping.stored_map import StoredMap
from offradar_ros.types import Pose

PAGE = 16384


@pytest.fixture(scope='module')
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of many pages, with three ended sessions that can be undone, and a saved one."""
    path = tmp_path_factory.mktemp('sound') / 'a.map'
    make_map(path, 1.0, 0.5)
    with open_map(path) as session_map:
        for uncertainty in (0.4, 0.3):
            session_map.start_session('long', 1)
            for metre in range(0, 2400, 6):
                session_map.merge(scan(metre, uncertainty), Pose(float(metre), 0.0))
            session_map.end_session()
        drive(session_map, 0.2, 15.0)
        session_map.save()
    return path


def flipped(content: bytearray, rng: random.Random) -> None:
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)


def overwritten(content: bytearray, rng: random.Random) -> None:
    content[rng.randrange(len(content))] = rng.randrange(256)


def zeroed(content: bytearray, rng: random.Random) -> None:
    start = PAGE * rng.randrange(len(content) // PAGE)
    content[start : start + PAGE] = bytes(PAGE)


def torn(content: bytearray, rng: random.Random) -> None:
    """The end of a page is that of another one."""
    to, start = (PAGE * rng.randrange(len(content) // PAGE) for _ in range(2))
    kept = 512 * rng.randrange(1, 8)
    content[to + kept : to + PAGE] = content[start + kept : start + PAGE]


def exchanged(content: bytearray, rng: random.Random) -> None:
    one, other = (PAGE * rng.randrange(len(content) // PAGE) for _ in range(2))
    page = content[one : one + PAGE]
    content[one : one + PAGE] = content[other : other + PAGE]
    content[other : other + PAGE] = page


def cut(content: bytearray, rng: random.Random) -> None:
    del content[rng.randrange(len(content)) :]


def longer(content: bytearray, rng: random.Random) -> None:
    content += bytes(rng.randrange(256) for _ in range(rng.randrange(1, 2 * PAGE)))


@pytest.mark.parametrize('damage', [flipped, overwritten, zeroed, torn, exchanged, cut, longer])
def test_damage_is_refused_or_changes_nothing(
    sound: Path, tmp_path: Path, damage: Callable[[bytearray, random.Random], None]
) -> None:
    written, rng, path = read_map(sound), random.Random(damage.__name__), tmp_path / 'a.map'
    outcomes = collections.Counter[str]()
    for _ in range(100):
        content = bytearray(sound.read_bytes())
        damage(content, rng)
        path.write_bytes(content)
        outcomes[outcome(path, written)] += 1
    assert set(outcomes) <= {'refused', 'same'}
    assert outcomes['refused'] or damage is longer


def test_neighbouring_pages_that_are_exchanged_are_noticed(sound: Path, tmp_path: Path) -> None:
    """Leaves of one table: each row is as it was written, and none is missing, but searches go wrong."""
    written, path = read_map(sound), tmp_path / 'a.map'
    outcomes = []
    for start in range(0, sound.stat().st_size - PAGE, PAGE):
        content = bytearray(sound.read_bytes())
        middle, end = start + PAGE, start + 2 * PAGE
        content[start:end] = content[middle:end] + content[start:middle]
        path.write_bytes(content)
        outcomes.append(outcome(path, written))
    assert set(outcomes) == {'refused'}


def test_free_pages_that_are_in_use_are_noticed(tmp_path: Path) -> None:
    """The next write would go into a page of the map."""
    path = tmp_path / 'a.map'
    with open_map(path) as session_map:
        session_map.adopt_model(MODEL)
        for start_m in range(0, 3000, 30):
            drive(session_map, 1.0, float(start_m))
            session_map.end_session()
        session_map.clear()
        drive(session_map, 1.0)
        session_map.end_session()
    content = bytearray(path.read_bytes())
    first_free = PAGE * (int.from_bytes(content[32:36], 'big') - 1)
    assert int.from_bytes(content[36:40], 'big') > 1
    content[first_free + 8 : first_free + 12] = (2).to_bytes(4, 'big')
    path.write_bytes(content)
    with pytest.raises(MapError, match='damaged'):
        open_map(path)


def outcome(path: Path, written: StoredMap) -> str:
    try:
        _, columns = read_committed(path, PlaceColumns)
        assert_tables_equal(columns.table, written.committed())
    except MapError:
        pass
    try:
        return difference(read_map(path), written) or 'same'
    except MapError as refused:
        assert '\n' not in str(refused) and str(path) in str(refused)
        return 'refused'


def test_what_can_differ_is_seen_as_a_difference(sound: Path, tmp_path: Path) -> None:
    """The comparison that the test above relies on."""
    written = read_map(sound)
    assert difference(written, read_map(sound)) == ''
    (tmp_path / 'b.map').write_bytes(sound.read_bytes())
    with open_map(tmp_path / 'b.map') as session_map:
        session_map.undo_session()
    assert difference(read_map(tmp_path / 'b.map'), written) == 'sessions'
    one, other = read_map(sound), read_map(sound)
    other.columns.table.uncertainties[3] += 1.0
    assert difference(one, other) == 'places'
    other = read_map(sound)
    other.signatures.popitem()  # type: ignore[attr-defined]
    assert difference(one, other) == 'signatures'
    other = read_map(sound)
    other.anchors_m[2, 1] += 0.5
    assert difference(one, other) == 'anchors'
    last = max(one.before)
    other = read_map(sound)
    first = next(iter(other.before[last]))
    del other.before[last][first]
    assert difference(one, other) == f'undo of session {last}'
    other = read_map(sound)
    del other.before[last]  # type: ignore[attr-defined]
    assert difference(one, other) == 'undo'
    other = read_map(sound)
    session, place = next(
        (session, place) for session, before in other.before.items() for place in before.values() if place
    )
    place.mean[0] += 1.0
    assert difference(one, other) == f'undo of session {session}'


@pytest.mark.parametrize(
    'statement',
    [
        'UPDATE places SET x_m = x_m + 0.001 WHERE place_id = 2',
        'UPDATE places SET anchor_y_m = 0.0 WHERE place_id = 2',
        'UPDATE places SET session_id = 2 WHERE place_id = 2',
        'UPDATE places SET uncertainty = 0.75 WHERE place_id = 2',
        'UPDATE places SET yaw_rad = 1.0 WHERE place_id = 2',
        'UPDATE places SET yaw_sd_rad = 0.5 WHERE place_id = 2',
        'UPDATE places SET yaw_sd_rad = NULL WHERE yaw_sd_rad IS NOT NULL',
        'UPDATE places SET stamp_ns = stamp_ns + 1 WHERE place_id = 2',
        'UPDATE places SET mean = (SELECT mean FROM places WHERE place_id = 3) WHERE place_id = 2',
        'UPDATE places SET digest = digest + 1 WHERE place_id = 2',
        'DELETE FROM places WHERE place_id = 2',
        'UPDATE places SET place_id = -1 WHERE place_id = 2',
        'UPDATE undo SET uncertainty = 0.75 WHERE existed = 1',
        'UPDATE undo SET existed = 0 WHERE existed = 1',
        'UPDATE undo SET by_session = 1 WHERE by_session = 3',
        'DELETE FROM undo WHERE by_session = 3',
        'UPDATE signatures SET session_id = 9 WHERE session_id = 2',
        'UPDATE signatures SET digest = digest + 1 WHERE session_id = 2',
        'DELETE FROM signatures WHERE session_id = 2',
        "UPDATE sessions SET state = 'undone' WHERE session_id = 2",
        "UPDATE sessions SET name = 'another' WHERE session_id = 2",
        'DELETE FROM sessions WHERE session_id = (SELECT max(session_id) FROM sessions)',
        "UPDATE meta SET value = '9999' WHERE key = 'next_place_id'",
        "UPDATE meta SET value = 'null' WHERE key = 'origin'",
        "INSERT INTO meta VALUES ('more', '1', 0)",
        "DELETE FROM meta WHERE key = 'seal'",
        "UPDATE meta SET value = replace(value, '\"generation\": ', '\"generation\": 1') WHERE key = 'seal'",
    ],
)
def test_no_row_can_be_changed_removed_or_added(tmp_path: Path, statement: str) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0, 0.75, 0.5, 0.4)
    change(path, statement)
    before = folder_state(tmp_path)
    for opener in (open_map, read_map, lambda path: read_committed(path, PlaceColumns)):
        with pytest.raises(MapError, match='damaged'):
            opener(path)
    assert folder_state(tmp_path) == before


@pytest.mark.parametrize(
    ('statement', 'reason'),
    [
        ("UPDATE signature_contents SET content = x'00' WHERE content_id = 3", 'is not as written'),
        (
            'UPDATE signature_contents SET content = (SELECT content FROM signature_contents WHERE content_id = 2) '
            'WHERE content_id = 3',
            'is not as written',
        ),
        ("UPDATE signature_contents SET content = 'text' WHERE content_id = 3", 'is not one'),
        ('UPDATE signature_contents SET content = zeroblob(8193) WHERE content_id = 3', 'is not one'),
        ('UPDATE signature_contents SET content_id = 99 WHERE content_id = 3', 'signature 99 is of no scan'),
        ("INSERT INTO signature_contents VALUES (99, x'00')", 'signature 99 is of no scan'),
        ('DELETE FROM signature_contents WHERE content_id = 3', '1 signatures are missing'),
        ('UPDATE signatures SET stamp_ns = stamp_ns + 100 WHERE session_id = 2', 'is not as written'),
        ('UPDATE signatures SET content_id = 2 WHERE content_id = 3', 'two scans have one signature'),
    ],
)
def test_a_signature_that_is_not_as_written_is_noticed(tmp_path: Path, statement: str, reason: str) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0, 0.75, 0.5, 0.4)
    change(path, statement)
    before = folder_state(tmp_path)
    for opener in (open_map, read_map):
        with pytest.raises(MapError, match=f'damaged .*{reason}') as refused:
            opener(path)
        assert '\n' not in str(refused.value)
    assert folder_state(tmp_path) == before


def test_who_does_not_read_signatures_reads_a_map_in_which_one_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    places = make_map(path, 1.0, 0.75)
    change(path, "UPDATE signature_contents SET content = x'00' WHERE content_id = 3")
    _, columns = read_committed(path, PlaceColumns)
    assert_tables_equal(columns.table, places)


def test_rows_that_change_places_are_noticed(tmp_path: Path) -> None:
    """Each row is as it was written, only under the id of another."""
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    change(
        path,
        'UPDATE places SET place_id = 100 WHERE place_id = 2',
        'UPDATE places SET place_id = 2 WHERE place_id = 3',
        'UPDATE places SET place_id = 3 WHERE place_id = 100',
    )
    with pytest.raises(MapError, match='2 rows of places are not as written, the first is 2'):
        read_map(path)


def test_a_row_of_an_earlier_state_is_noticed(tmp_path: Path) -> None:
    """It has its own digest, but is not what was written last: only the sum can show it."""
    path, older = tmp_path / 'a.map', tmp_path / 'older.map'
    make_map(path, 1.0)
    shutil.copy(path, older)
    with open_map(path) as session_map:
        drive(session_map, 0.5)
        session_map.end_session()
    with sqlite3.connect(path) as connection:
        connection.execute('ATTACH ? AS older', [str(older)])
        connection.execute('REPLACE INTO places SELECT * FROM older.places WHERE place_id = 2')
    connection.close()
    with pytest.raises(MapError, match='it should hold 6 rows of places, and not these 6'):
        read_map(path)


@pytest.mark.parametrize(
    'statement',
    [
        'CREATE TRIGGER t AFTER INSERT ON places BEGIN DELETE FROM places; END',
        'CREATE VIEW v AS SELECT * FROM places',
        'CREATE TABLE more (a)',
        'CREATE INDEX i ON places (session_id)',
        'ALTER TABLE places ADD COLUMN more',
        'DROP TABLE undo',
    ],
)
@pytest.mark.parametrize('version', [1, 2, 3])
def test_a_map_holds_its_tables_and_nothing_else(tmp_path: Path, statement: str, version: int) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    if version < 3:
        as_version_1(path) if version == 1 else as_version_2(path)
    change(path, statement)
    with pytest.raises(MapError, match='its tables are not those of a map'):
        open_map(path)


IMPOSSIBLE = [
    'UPDATE places SET x_m = 1e9 WHERE place_id = 2',
    'UPDATE places SET x_m = 9e999 WHERE place_id = 2',
    'UPDATE places SET anchor_x_m = -1e9 WHERE place_id = 2',
    'UPDATE places SET yaw_rad = 9e999 WHERE place_id = 2',
    'UPDATE places SET uncertainty = -1.0 WHERE place_id = 2',
    'UPDATE places SET session_id = 77 WHERE place_id = 2',
    'UPDATE places SET session_id = 99999999999 WHERE place_id = 2',
    "UPDATE places SET stamp_ns = 'now' WHERE place_id = 2",
    "UPDATE places SET mean = x'0000000000000000' WHERE place_id = 2",
    "UPDATE places SET mean = '000000000000' WHERE place_id = 2",
    'UPDATE places SET place_id = 9999 WHERE place_id = 2',
    'UPDATE places SET place_id = -9 WHERE place_id = 2',
    'UPDATE undo SET place_id = 4000 WHERE place_id = 2',
    'UPDATE undo SET by_session = 55 WHERE by_session = 2',
    'UPDATE undo SET existed = 7 WHERE existed = 1',
    'DELETE FROM places WHERE place_id = 2',
    'DELETE FROM sessions WHERE session_id = 1',
    'UPDATE sessions SET session_id = -4 WHERE session_id = 1',
    "UPDATE sessions SET report = '[]' WHERE session_id = 2",
    "UPDATE sessions SET report = '{}' WHERE session_id = 2",
    "UPDATE meta SET value = '-1' WHERE key = 'next_place_id'",
    "UPDATE meta SET value = '1.5' WHERE key = 'next_place_id'",
    "UPDATE meta SET value = replace(value, '3', '1000000000000') WHERE key = 'model'",
    "UPDATE meta SET value = replace(value, 'aaaa', 'xyz') WHERE key = 'model'",
    "UPDATE meta SET value = '" + '[' * 10000 + ']' * 10000 + "' WHERE key = 'origin'",
    'UPDATE meta SET value = \'{"latitude_deg": 1e999, "longitude_deg": 0}\' WHERE key = \'origin\'',
]


@pytest.mark.parametrize('statement', IMPOSSIBLE)
def test_values_that_no_map_holds_are_refused_without_digests_too(tmp_path: Path, statement: str) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0, 0.5)
    as_version_1(path)
    change(path, statement)
    before = folder_state(tmp_path)
    for opener in (open_map, read_map):
        with pytest.raises(MapError, match='damaged') as refused:
            opener(path)
        assert '\n' not in str(refused.value)
    assert folder_state(tmp_path) == before


def test_a_file_calls_no_function_of_the_program(tmp_path: Path) -> None:
    path, calls = tmp_path / 'a.map', list[int]()
    make_map(path, 1.0)
    change(path, 'CREATE VIEW v AS SELECT call(place_id) FROM places')
    with contextlib.closing(open_sqlite(path, ALONE)) as connection:
        connection.create_function('call', 1, calls.append)
        with pytest.raises(sqlite3.OperationalError, match='unsafe use of call'):
            connection.execute('SELECT * FROM v').fetchall()
    assert calls == []


@pytest.mark.skipif(sys.version_info < (3, 11), reason='sqlite3 has no limits before Python 3.11')
def test_text_of_any_length_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    as_version_1(path)
    change(path, 'UPDATE sessions SET name = hex(zeroblob(10000000))')
    with pytest.raises(MapError, match=r'damaged .*too big'):
        read_map(path)


def test_a_map_whose_ids_reach_far_takes_no_memory_for_those_between(tmp_path: Path) -> None:
    path = tmp_path / 'a.map'
    make_map(path, 1.0)
    as_version_1(path)
    far = 2**32 - 2
    change(
        path,
        f'UPDATE places SET place_id = {far} WHERE place_id = 5',
        f'UPDATE undo SET place_id = {far} WHERE place_id = 5',
        f"UPDATE meta SET value = '{far + 1}' WHERE key = 'next_place_id'",
    )
    assert read_map(path).places.place_ids[-1] == far
    np.testing.assert_array_equal(read_map(path).places.place_ids[:5], np.arange(5))


def test_what_is_not_a_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'fifo')
    for path in (tmp_path, tmp_path / 'fifo', Path('/dev/zero')):
        with pytest.raises(MapError, match='not a file: expected the path of a map file'):
            read_map(path)
    with pytest.raises(MapError, match='not a file: expected'):
        open_map(tmp_path / 'fifo')
