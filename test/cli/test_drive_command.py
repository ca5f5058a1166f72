"""`offradar drive` and `offradar map`: two sessions, then a query, on one map file."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from offradar_ros.mapping.store import MapStore

HOUR_NS = 3600 * 10**9
START_NS = 1_600_000_000 * 10**9
COUNT = 10


def answers(printed: str) -> dict[str, int]:
    """Rows of the table."""
    return {name.strip(): int(count) for name, count in re.findall(r'│ ([^│]+) │ +(\d+) +│', printed)}


@pytest.fixture
def drives(street_bag: Callable[..., Path]) -> list[Path]:
    return [
        street_bag(f'drive_{k}', count=COUNT, start_ns=START_NS + k * HOUR_NS, lane_m=0.5 * k, noise_seed=k)
        for k in range(3)
    ]


@pytest.fixture
def params(tmp_path: Path) -> Path:
    path = tmp_path / 'params.yaml'
    path.write_text('encoder: {ring_key: {variance_scale: 2.1}}\nmap: {match_distance_m: 4.0}\nquery: {delta: 0.4}\n')
    return path


def test_two_sessions_then_a_query(done: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path) -> None:
    db = tmp_path / 'map.db'
    first = done('drive', drives[0], '--params', params, '--map', db, '--session', 'one')
    assert answers(first) == {'rejected: map_empty': COUNT}
    inserted, replaced, kept = map(int, re.findall(r'(\d+) (?:inserted|replaced|kept)', first))
    assert 'session 1 (one): ' in first
    assert inserted + replaced + kept == COUNT
    second = done('drive', drives[1], '--params', params, '--map', db, '--session', 'two')
    assert answers(second) == {'match': COUNT}
    assert f'places {inserted} -> ' in second
    before = MapStore.open_read_only(db)
    third = done('drive', drives[2], '--params', params, '--map', db)
    assert answers(third) == {'match': COUNT}
    assert 'session' not in third
    after = MapStore.open_read_only(db)
    assert [s.name for s in after.sessions] == ['one', 'two']
    assert after.places.stamps_ns.tolist() == before.places.stamps_ns.tolist()
    shown = done('map', db)
    assert shown.startswith(f'{db}: {len(after.places)} places\nmodel: ring_key, d = 128, ')
    assert 'origin: 51.75' in shown
    rows = [[cell.strip() for cell in line.split('│')[1:-1]] for line in shown.splitlines() if line.startswith('│')]
    assert [row[:6] for row in rows] == [
        ['1', 'one', 'ended', str(inserted), str(replaced), str(kept)],
        ['2', 'two', 'ended', *re.findall(r'(\d+) (?:inserted|replaced|kept)', second)],
    ]


def test_without_a_file_the_map_is_in_memory(done: Callable[..., str], drives: list[Path], tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())
    assert answers(done('drive', drives[0], '--session', 'one')) == {'rejected: map_empty': COUNT}
    assert answers(done('drive', drives[1])) == {'rejected: map_empty': COUNT}
    assert sorted(tmp_path.iterdir()) == before


def test_names_with_brackets_and_braces_are_printed_as_they_are(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    name = '[/b]{c}'
    bag = street_bag('bag', count=3).rename(tmp_path / 'a[red]{}')
    said = done('drive', bag, '--map', tmp_path / 'map.db', '--session', name)
    assert f'session 1 ({name}): ' in said
    assert f'│{name} ' in done('map', tmp_path / 'map.db')


def test_a_map_of_another_model_is_refused_and_kept(
    done: Callable[..., str], refused: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path
) -> None:
    db = tmp_path / 'map.db'
    done('drive', drives[0], '--params', params, '--map', db, '--session', 'one')
    before = db.read_bytes()
    for arguments in ([], ['--session', 'two']):
        assert re.search(
            f'{db}: holds embeddings of ring_key [0-9a-f]+, not of ring_key [0-9a-f]+',
            refused('drive', drives[1], '--map', db, *arguments),
        )
    assert db.read_bytes() == before


@pytest.mark.parametrize('name', ['no/map.db', '', '.', '/'])
def test_a_map_that_cannot_be_written_is_refused(
    refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path, name: str
) -> None:
    bag = street_bag('bag', count=2)
    path = f'{tmp_path}/{name}' if name.startswith('no') else name
    assert re.search(
        r'cannot be written there|a folder: expected', refused('drive', bag, '--map', path, '--session', 'one')
    )


def test_a_file_that_is_no_map_is_refused_and_kept(
    refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    letter = tmp_path / 'letter.txt'
    letter.write_text('Dear all, ' * 100)
    for arguments in (['drive', street_bag('bag', count=2), '--map', letter], ['map', letter]):
        assert str(letter) in refused(*arguments)
    assert letter.read_text() == 'Dear all, ' * 100


def test_a_query_of_a_map_that_is_not_there_is_refused(
    refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    db = tmp_path / 'nothing.db'
    assert 'no map file there' in refused('map', db)
    assert 'no map file there: --session NAME starts one' in refused('drive', street_bag('bag', count=2), '--map', db)
    assert not db.exists()


def test_bags_that_cannot_be_driven_are_refused(
    refused: Callable[..., str], street_bag: Callable[..., Path], radiate_folder: Path, tmp_path: Path
) -> None:
    bag = street_bag('bag', count=3)
    (tmp_path / 'bad.yaml').write_text('query: {levle: 3}')
    assert 'parameter query.levle is unknown' in refused('drive', bag, '--params', tmp_path / 'bad.yaml')
    assert 'no such bag' in refused('drive', tmp_path / 'nothing')
    assert 'not a rosbag2 folder' in refused('drive', radiate_folder)
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:5000])
    assert 'not a readable rosbag2 recording' in refused('drive', bag, '--map', tmp_path / 'map.db', '--session', 'one')
    assert not (tmp_path / 'map.db').exists()


def test_a_drive_that_breaks_off_changes_no_map(
    done: Callable[..., str], offradar: Callable[..., Any], drives: list[Path], tmp_path: Path
) -> None:
    db = tmp_path / 'map.db'
    done('drive', drives[0], '--map', db, '--session', 'one')
    before = MapStore.open_read_only(db)
    (file,) = drives[1].glob('*.mcap')
    data = bytearray(file.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 300_000] = bytes(300_000)
    file.write_bytes(data)
    ran = offradar('drive', drives[1], '--map', db, '--session', 'two')
    assert ran.status == 1
    assert 'error: ' in ran.err.splitlines()[-1]
    after = MapStore.open_read_only(db)
    assert [s.name for s in after.sessions] == ['one']
    assert after.places.stamps_ns.tolist() == before.places.stamps_ns.tolist()


def test_a_recorded_drive_finds_itself(done: Callable[..., str], real_data: Path, tmp_path: Path) -> None:
    done('convert', real_data / 'oxford_tiny', tmp_path / 'bag')
    done('calibrate', tmp_path / 'bag', '--out', tmp_path / 'params.yaml')
    options = ['--params', tmp_path / 'params.yaml', '--map', tmp_path / 'map.db']
    assert answers(done('drive', tmp_path / 'bag', *options, '--session', 'one')) == {'rejected: map_empty': 11}
    found = answers(done('drive', tmp_path / 'bag', *options))
    assert found.pop('match') >= 10
    assert set(found) <= {'rejected: uncertain'}
