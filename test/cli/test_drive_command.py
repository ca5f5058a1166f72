"""`offradar drive` and `offradar map`: two sessions, then a query, on one map file."""

from __future__ import annotations

import csv
import dataclasses
import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commands import RING_KEY
from small_maps import as_version_1, change

from offradar_ros.config import MapConfig, load_config
from offradar_ros.mapping.schema import VERSION
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.store import MapStore
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.types import LocalisationState

HOUR_NS = 3600 * 10**9
START_NS = 1_600_000_000 * 10**9
COUNT = 10


def rows(printed: str) -> dict[str, int]:
    """Rows of all tables."""
    return {name.strip(): int(count) for name, count in re.findall(r'│ ([^│]+) │ +(\d+) +│', printed)}


def answers(printed: str) -> dict[str, int]:
    """Rows of the table of answers."""
    return {name: count for name, count in rows(printed).items() if name not in set(LocalisationState)}


@pytest.fixture
def drives(street_bag: Callable[..., Path]) -> list[Path]:
    return [
        street_bag(f'drive_{k}', count=COUNT, start_ns=START_NS + k * HOUR_NS, lane_m=0.5 * k, noise_seed=k)
        for k in range(3)
    ]


@pytest.fixture
def params(tmp_path: Path) -> Path:
    path = tmp_path / 'params.yaml'
    path.write_text(
        'encoder: {name: ring_key, ring_key: {variance_scale: 2.1}}\n'
        'map: {match_distance_m: 4.0}\nquery: {delta: 0.4}\n'
    )
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
    assert [row[:8] for row in rows if row[0]] == [
        ['1', 'one', '2020-09-13', 'ended', str(inserted), str(replaced), str(kept), '0'],
        ['2', 'two', '2020-09-13', 'ended', *re.findall(r'(\d+) (?:inserted|replaced|kept|dropped)', second)],
    ]
    assert 'interrupted' not in shown


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
    printed = done('drive', bag, '--map', tmp_path / 'map.db', '--session', name)
    assert f'session 1 ({name}): ' in printed
    assert f'│{name}│' in done('map', tmp_path / 'map.db')


def test_a_map_of_another_model_is_refused_and_kept(
    done: Callable[..., str], refused: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path
) -> None:
    db = tmp_path / 'map.db'
    done('drive', drives[0], '--params', params, '--map', db, '--session', 'one')
    before = db.read_bytes()
    for arguments in (RING_KEY, [*RING_KEY, '--session', 'two']):
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


def test_a_drive_that_ends_with_an_error_changes_no_map(
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


def test_a_query_needs_no_writer_and_writes_nothing(
    done: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path
) -> None:
    db = tmp_path / 'map.db'
    done('drive', drives[0], '--params', params, '--map', db, '--session', 'one')
    config = load_config(params, {'map.path': str(db)})
    before = db.read_bytes()
    with SessionMap(config.map):
        assert answers(done('drive', drives[1], '--params', params, '--map', db)) == {'match': COUNT}
    assert db.read_bytes() == before


def test_answers_are_written_as_a_row_for_each_scan(
    done: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path
) -> None:
    db, out = tmp_path / 'map.db', tmp_path / 'answers.csv'
    first = done('drive', drives[0], '--params', params, '--map', db, '--session', 'one', '--out', out)
    assert 'Recall' not in first
    with out.open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [(row['answer'], row['reason'], row['place_id']) for row in rows] == [('rejected', 'map_empty', '')] * COUNT
    assert all(row['true_x_m'] and not row['error_m'] for row in rows)
    printed = done('drive', drives[1], '--params', params, '--map', db, '--out', out)
    assert f'Recall@1 within 25 m: 1.000 of {COUNT} scans, 1.000 of {COUNT} matches\n' in printed
    assert printed.endswith(f'{out}: written\n')
    with out.open(newline='') as file:
        rows = list(csv.DictReader(file))
    stored = MapStore.open_read_only(db).places
    assert [int(row['stamp_ns']) for row in rows] == BagSequence(drives[1]).stamps_ns.tolist()
    for index, row in enumerate(rows):
        assert (row['answer'], row['reason']) == ('match', '')
        assert float(row['uncertainty']) <= float(row['threshold'])
        (place,) = (stored.place_ids == int(row['place_id'])).nonzero()[0]
        assert [float(row['x_m']), float(row['y_m'])] == stored.positions_m[place, :2].tolist()
        # The frame starts at the first fix, 5 m behind the first scan of the first drive.
        assert float(row['true_x_m']) == pytest.approx(5.0 + 1.25 * index, abs=0.01)
        assert float(row['true_y_m']) == pytest.approx(0.5, abs=0.01)
        apart = [float(row[f'{axis}_m']) - float(row[f'true_{axis}_m']) for axis in 'xy']
        assert float(row['error_m']) == pytest.approx(math.hypot(*apart))


def test_recall_is_of_the_scans_on_the_map(
    done: Callable[..., str], street_bag: Callable[..., Path], params: Path, tmp_path: Path
) -> None:
    road, longer, away = street_bag('road', count=20), street_bag('longer', count=60), street_bag('away', lane_m=400.0)
    db = tmp_path / 'map.db'
    done('drive', road, '--params', params, '--map', db, '--session', 'one')
    printed = done('drive', longer, '--params', params, '--map', db)
    # The map ends 23.75 m after its first scan, and the tolerance 25 m farther: scans are 1.25 m apart.
    line = r'Recall@1 within 25 m: 0\.\d{3} of 39 scans on the map, 0\.\d{3} of 39 matches on the map; '
    assert re.search(line + 'off the map, 21 of 21 scans are answered\n', printed)
    printed = done('drive', away, '--params', params, '--map', db)
    assert 'Recall@1 within 25 m: -, no scan is on the map; off the map, ' in printed
    assert '0.000' not in printed


def test_answers_that_cannot_be_written_are_refused_first(
    refused: Callable[..., str], drives: list[Path], tmp_path: Path
) -> None:
    out = tmp_path / 'no' / 'answers.csv'
    printed = refused('drive', drives[0], '--map', tmp_path / 'map.db', '--session', 'one', '--out', out)
    assert f'{out}: cannot be written' in printed
    assert not (tmp_path / 'map.db').exists()


def test_a_session_without_positions_reports_why_nothing_was_mapped(
    done: Callable[..., str], street: Callable[..., Any], tmp_path: Path
) -> None:
    drive = street(count=4)
    bag = write_bag(drive.with_trajectory(None), tmp_path / 'bag')
    printed = done('drive', bag, '--map', tmp_path / 'map.db', '--session', 'one')
    assert (
        'note: nothing was mapped: the bag has no sensor_msgs/msg/NavSatFix, which position.source: fix asks for'
    ) in printed
    late = dataclasses.replace(drive.trajectory, stamps_ns=drive.trajectory.stamps_ns + 5 * 10**9)
    bag = write_bag(drive.with_trajectory(late), tmp_path / 'late')
    printed = done('drive', bag, '--map', tmp_path / 'map.db', '--session', 'one')
    assert 'note: nothing was mapped: 4 scans no_position' in printed
    # Dropped scans are a second table.
    assert printed.index('rejected: map_empty') < printed.index('┃ dropped') < printed.index('│ no_position')


def test_ctrl_c_ends_the_session_and_keeps_it(street_bag: Callable[..., Path], tmp_path: Path) -> None:
    bag, db = street_bag('long', count=600), tmp_path / 'map.db'
    code = (
        'import os, signal, sys\n'
        'from offradar_ros.stages import encode as stage\n'
        'from offradar_ros.cli.main import main\n'
        'encode = stage.EncodeStage.encode\n'
        'def interrupted(self, *scan):\n'
        '    interrupted.count += 1\n'
        '    if interrupted.count == 20:\n'
        '        os.kill(os.getpid(), signal.SIGINT)\n'
        '    return encode(self, *scan)\n'
        'interrupted.count = 0\n'
        'stage.EncodeStage.encode = interrupted\n'
        'sys.exit(main())\n'
    )
    command = [sys.executable, '-c', code, 'drive', str(bag), '--map', str(db), '--session', 'one']
    ran = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    assert ran.returncode == 130, ran.stderr
    assert 'Traceback' not in ran.stderr
    (line,) = ran.stdout.splitlines()
    assert line.startswith('interrupted, what was mapped is kept: session 1 (one): ')
    stored = MapStore.open_read_only(db)
    assert [session.state for session in stored.sessions] == ['ended']
    inserted, replaced, kept = map(int, re.findall(r'(\d+) (?:inserted|replaced|kept)', line))
    assert 10 < inserted + replaced + kept <= 20
    assert len(stored.places) == inserted


def test_an_interrupted_session_is_explained(
    done: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path
) -> None:
    db = tmp_path / 'map.db'
    done('drive', drives[0], '--params', params, '--map', db, '--session', 'one')
    as_version_1(db)
    change(db, "UPDATE sessions SET state = 'interrupted'")
    shown = done('map', db)
    assert '│interrupted' in shown
    assert shown.splitlines()[-1].startswith('interrupted: saved, then the process ended')


def test_a_session_is_interrupted_if_its_process_was_killed_and_runs_if_it_lives(
    done: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path
) -> None:
    db, link = tmp_path / 'map.db', tmp_path / 'link.db'
    done('drive', drives[0], '--params', params, '--map', db, '--session', 'one')
    as_version_1(db)
    change(db, "UPDATE sessions SET state = 'running'")
    link.symlink_to(db)
    before = db.read_bytes()
    for path in (db, link):
        shown = done('map', path)
        assert '│interrupted' in shown
        assert shown.splitlines()[-1].startswith('interrupted: saved, then the process ended')
    assert db.read_bytes() == before
    with SessionMap(MapConfig(path=str(db))):
        for path in (db, link):
            shown = done('map', path)
            assert '│running' in shown
            assert '│interrupted' not in shown
    # Left by a process that was killed: nothing holds it.
    db.with_name('map.db.lock').touch()
    assert '│interrupted' in done('map', db)


def test_a_session_that_cannot_be_written_is_kept_in_another_file(
    refused: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    db = tmp_path / 'maps' / 'map.db'
    db.parent.mkdir()
    end = SessionMap.end_session

    def remove_and_end(session_map: SessionMap) -> Any:
        db.unlink()
        return end(session_map)

    monkeypatch.setattr(SessionMap, 'end_session', remove_and_end)
    printed = refused('drive', drives[0], '--params', params, '--map', db, '--session', 'one')
    (rescued,) = db.parent.glob('map.db.rescued-*.db')
    assert 'the map file was removed' in printed and f'what was mapped is kept in {rescued}' in printed
    (session,) = MapStore.open_read_only(rescued).sessions
    assert (session.name, session.state) == ('one', 'interrupted')
    assert len(MapStore.open_read_only(rescued).places) == session.report['inserted']


def test_an_upgrade_is_told_of(done: Callable[..., str], drives: list[Path], params: Path, tmp_path: Path) -> None:
    db = tmp_path / 'map.db'
    done('drive', drives[0], '--params', params, '--map', db, '--session', 'one')
    as_version_1(db)
    assert 'upgraded' not in done('drive', drives[1], '--params', params, '--map', db)
    printed = done('drive', drives[1], '--params', params, '--map', db, '--session', 'two')
    assert f'{db}: upgraded from map format 1 to {VERSION}; the file as it was is kept as map.db.v1.bak\n' in printed
    assert len(MapStore.open_read_only(db).sessions) == 2
