"""`offradar evaluate`, from a protocol to files."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from commands import RING_KEY
from recorded_topics import fixes, record, scans
from street_sequence import ORIGIN, StreetSequence
from typer.testing import CliRunner

from offradar_ros.cli.main import app
from offradar_ros.geometry import GeoPoint, LocalFrame, utm_to_geodetic
from offradar_ros.lab.evaluation.results.file import read_results
from offradar_ros.recordings.datasets.oxford_writer import write_oxford
from offradar_ros.recordings.datasets.splits import read_split
from offradar_ros.shipped import shipped_file

PROTOCOL = """
name: tiny
title: Two tiny cities
groups:
  - {name: a, title: A, physics: drawn, cities: [2999991], streets: [
      {name: toy, map: toy.yaml, traversals: [a.tum, b.tum], seed: 2999993}]}
lanes: [{}, {left_m: 1.0}, {left_m: -1.0}]
scans: 4
validation: {cities: [2999992], scans: 3}
resamples: 5
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('evaluate')
    (folder / 'tiny.yaml').write_text(PROTOCOL)
    return folder


def evaluate(folder: Path, out: str, *more: str) -> str:
    command = ['evaluate', str(folder / 'tiny.yaml'), '--method', 'ring_key', '--out', str(folder / out)]
    done = CliRunner().invoke(
        app, [*command, '--cache', str(folder / 'cache'), '--processes', '2', *more], catch_exceptions=False
    )
    assert done.exit_code == 0
    return done.stdout


def test_an_evaluation_is_repeated_from_its_cache(folder: Path) -> None:
    pytest.importorskip('matplotlib')
    output = evaluate(folder, 'first')
    assert 'toy: maps and traversals are not given' in output
    assert 'Alignments: pairs within 10 m' not in output
    cached = {path: path.stat().st_mtime_ns for path in (folder / 'cache').rglob('*.*')}
    evaluate(folder, 'second', '--no-pictures')
    assert {path: path.stat().st_mtime_ns for path in (folder / 'cache').rglob('*.*')} == cached
    first, second = (read_results(folder / out / 'results.json') for out in ('first', 'second'))
    assert repr(first.groups) == repr(second.groups)
    assert repr(first.maintenance) == repr(second.maintenance)
    assert set(first.groups) == {'a', 'all'}
    assert first.groups['a']['5']['ring_key'].pairs == 6
    assert first.seeds == (2999991, 2999993, 2999992, 0)
    assert (folder / 'first' / 'recall_at_rejection.png').is_file()
    assert (folder / 'first' / 'extremes_ring_key.png').is_file()
    assert not list((folder / 'second').glob('*.png'))


@pytest.fixture(scope='module')
def oxford(tmp_path_factory: pytest.TempPathFactory, street: Callable[..., StreetSequence]) -> Path:
    """Five short drives under the names of the test sequences, where the test region is."""
    root = tmp_path_factory.mktemp('oxford')
    split = read_split('oxford')
    circle = split.region.circles[0]
    centre = utm_to_geodetic(np.array([[circle.easting_m, circle.northing_m, 60.0]]), split.region.epsg)[0]
    for number, name in enumerate(split.test):
        drive = street(count=14, lane_m=0.7 * number, noise_seed=number)
        positions_m = LocalFrame(ORIGIN).to_enu(drive.trajectory.positions)
        moved = LocalFrame(GeoPoint(*centre.tolist())).to_geodetic(positions_m)
        write_oxford(drive.with_trajectory(dataclasses.replace(drive.trajectory, positions=moved)), root / name)
    return root


def test_the_papers_oxford_experiment(oxford: Path, tmp_path: Path, done: Callable[..., str]) -> None:
    pytest.importorskip('matplotlib')
    pytest.importorskip('jinja2')
    out = tmp_path / 'out'
    output = done('evaluate', 'oxford', '--data', oxford, '--method', 'ring_key', '--out', out)
    assert '2019-01-10-14-36-48-radar-oxford-10k-partial: not found' in output
    results = read_results(out / 'results.json')
    figures = results.groups['oxford']['0']['ring_key']
    assert (figures.pairs, figures.queries) == (20, 20 * 14)
    assert results.maintenance['oxford']['0']['ring_key'].ordered_pairs == 20
    assert 'report.html' in done('report', out)
    text = (out / 'report' / 'report.md').read_text()
    assert '| RingKey | ' in text
    assert '83.68 / 86.49 / 88.32 | 0.85 / 0.81 / 0.71 | 0.94 |' in text
    assert 'simulated' not in text
    # A missing test sequence is named, and the others are measured.
    fast = ('--no-pictures', '--alignments', 0)
    (oxford / results.drives[0].name).rename(oxford / 'elsewhere')
    again = done('evaluate', 'oxford', '--data', oxford, '--method', 'ring_key', '--out', out, *fast)
    assert 'oxford: not found: 2019-01-18-14-46-59-radar-oxford-10k in' in again


def test_missing_data_of_a_protocol_is_named(tmp_path: Path, refused: Callable[..., str]) -> None:
    output = refused('evaluate', 'mulran', '--data', tmp_path, '--method', 'ring_key', '--out', tmp_path / 'out')
    assert 'riverside: not found: Riverside01, Riverside02 in' in output
    assert 'expected a YAML file or one of the protocols' in refused('evaluate', 'cambridge', '--out', tmp_path)


def test_own_recordings(street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str]) -> None:
    bags = [street_bag(f'day_{number}', count=16, noise_seed=number, lane_m=0.5 * number) for number in range(3)]
    (tmp_path / 'car.yaml').write_text('query: {delta: 0.4, levels: 4, level: 3}\n')
    named = ['--map', bags[0], '--map', bags[1], '--query', bags[2], '--params', tmp_path / 'car.yaml']
    named += ['--method', 'ring_key', '--cache', tmp_path / 'cache']
    output = done('encode', 'own', *named)
    assert 'ring_key: 48 scans of 3 drives encoded, 0 refused' in output
    done('evaluate', *named, '--out', tmp_path, '--no-pictures')
    results = read_results(tmp_path / 'results.json')
    assert [drive.name for drive in results.drives] == ['day_0', 'day_1', 'day_2']
    assert [drive.roles for drive in results.drives] == ['mapped', 'mapped', 'searched']
    figures = results.groups['own']['5']['ring_key']
    assert (figures.pairs, figures.queries) == (2, 32)
    assert results.maintenance['own']['5']['ring_key'].ordered_pairs == 2
    assert figures.at_deployed_threshold is not None
    assert figures.at_deployed_threshold.threshold == pytest.approx(1.2)
    # A threshold of another model is not used.
    (tmp_path / 'car.yaml').write_text('query: {delta: 0.4, levels: 4, level: 3, model: abc}\n')
    output = done('evaluate', 'own', *named, '--out', tmp_path, '--no-pictures')
    assert 'ring_key: the threshold of --params is for model abc, the method is ' in output
    results = read_results(tmp_path / 'results.json')
    assert results.groups['own']['5']['ring_key'].at_deployed_threshold is None
    assert math.isnan(results.maintenance['own']['5']['ring_key'].recall_at_1['QM'])


@pytest.mark.parametrize('command', ['encode', 'evaluate'])
def test_the_topics_of_own_recordings_are_chosen(
    street: Callable[..., Any],
    tmp_path: Path,
    done: Callable[..., str],
    refused: Callable[..., str],
    command: str,
) -> None:
    call: list[object] = [command, 'own', '--method', 'ring_key', '--cache', tmp_path / 'cache']
    call += ['--out', tmp_path / 'out', '--no-pictures'] if command == 'evaluate' else []
    for option, name in (('--map', 'monday'), ('--query', 'friday')):
        front, rear = street(count=8), street(count=16)
        positions = [fixes(rear, topic) for topic in ('/novatel/fix', '/ublox/fix')]
        record(tmp_path / name, scans(front, '/front/scan'), scans(rear, '/rear/scan'), *positions)
        call += [option, tmp_path / name]
    assert 'choose one with --topic' in refused(*call)
    assert 'choose one with --positions' in refused(*call, '--topic', '/front/scan')
    output = done(*call, '--topic', '/front/scan', '--positions', '/ublox/fix')
    if command == 'encode':
        assert 'ring_key: 16 scans of 2 drives encoded' in output


def test_a_calibrated_encoder_is_evaluated_with_its_threshold(
    street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str]
) -> None:
    bags = [street_bag(f'day_{number}', count=16, noise_seed=number) for number in range(3)]
    done('calibrate', bags[0], *RING_KEY, '--out', tmp_path / 'car.yaml')
    written = yaml.safe_load((tmp_path / 'car.yaml').read_text())['/**']['ros__parameters']
    named = ['--map', bags[1], '--query', bags[2], '--params', tmp_path / 'car.yaml', '--method', 'ring_key']
    output = done('evaluate', *named, '--out', tmp_path / 'out', '--no-pictures')
    assert 'threshold of --params' not in output
    results = read_results(tmp_path / 'out' / 'results.json')
    assert results.methods['ring_key'].fingerprint == written['query']['model']
    query = written['query']
    expected = 1.0 - query['delta'] + 2.0 * query['delta'] * query['level'] / query['levels']
    figures = results.groups['own']['5']['ring_key']
    assert figures.at_deployed_threshold is not None
    assert figures.at_deployed_threshold.threshold == pytest.approx(expected)
    assert results.protocol.title == 'Own recordings'
    # A single pair has no interval.
    assert math.isnan(figures.recall_at_1.low)


@pytest.mark.parametrize('role', ['map', 'query'])
def test_a_recording_without_signal_is_mapped_or_searched_for(
    role: str, street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str]
) -> None:
    pytest.importorskip('matplotlib')
    pytest.importorskip('jinja2')
    near = street_bag('near', count=8)
    blank = street_bag('blank', count=8, silent=True)
    maps, queries = {'map': (blank, near), 'query': (near, blank)}[role]
    out = tmp_path / 'out'
    output = done('evaluate', '--map', maps, '--query', queries, '--method', 'ring_key', '--out', out)
    assert {'map': 'blank: none of its scans can be mapped'}.get(role, '') in output
    assert 'report.html' in done('report', out)
    results = read_results(out / 'results.json')
    figures = results.groups['own']['5']['ring_key']
    assert figures.recall_at_1.value == 0.0
    assert 'The threshold in use' not in (out / 'report' / 'report.md').read_text()


def test_pictures_and_arrays_of_another_evaluation_are_not_reported(
    street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str], refused: Callable[..., str]
) -> None:
    pytest.importorskip('matplotlib')
    bags = [street_bag(f'day_{number}', count=8 + number, noise_seed=number) for number in range(3)]
    first, second = (
        ['--map', bags[0], '--query', query, '--method', 'ring_key', '--cache', tmp_path / 'cache']
        for query in bags[1:]
    )
    done('evaluate', *first, '--out', tmp_path / 'out')
    assert (tmp_path / 'out' / 'extremes_ring_key.png').is_file()
    done('evaluate', *second, '--out', tmp_path / 'out', '--no-pictures')
    assert not list((tmp_path / 'out').glob('*.png'))
    done('evaluate', *first, '--out', tmp_path / 'other', '--no-pictures')
    (tmp_path / 'out' / 'scans.npy').write_bytes((tmp_path / 'other' / 'scans.npy').read_bytes())
    assert 'are not of the same evaluation as results.json' in refused('report', tmp_path / 'out')


def test_revisits_of_one_recording(street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str]) -> None:
    day = street_bag('day', count=24)
    named = ['--map', day, '--query', day, '--method', 'ring_key', '--no-pictures']
    done('evaluate', *named, '--exclusion-s', 2, '--out', tmp_path / 'near')
    figures = read_results(tmp_path / 'near' / 'results.json').groups['own']['5']['ring_key']
    assert (figures.pairs, figures.queries) == (1, 24)
    output = done('evaluate', *named, '--exclusion-s', 60, '--out', tmp_path / 'far')
    assert 'note: day: never returns to a place' in output
    assert 'report.html' in done('report', tmp_path / 'far')


def test_stretches_of_the_mapped_road_are_left_out(
    street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str], refused: Callable[..., str]
) -> None:
    pytest.importorskip('matplotlib')
    pytest.importorskip('jinja2')
    bags = [street_bag(f'day_{number}', count=150, noise_seed=number) for number in range(2)]
    named = ['--map', bags[0], '--query', bags[1], '--method', 'ring_key', '--cache', tmp_path / 'cache']
    output = done('evaluate', *named, '--leave-out-m', 60, '--out', tmp_path / 'out', '--no-pictures')
    assert 'PA ratio' in output
    results = read_results(tmp_path / 'out' / 'results.json')
    assert results.protocol.leave_out_m == 60.0
    figures = results.groups['own']['5']['ring_key']
    assert figures.pairs == 1
    # Scans are 1 m apart, of which those within 25 m of a mapped stretch are on the map.
    assert figures.queries == figures.open_set.on_map + figures.open_set.off_map == 2 * results.drives[1].scans
    assert 0 < figures.open_set.off_map < figures.open_set.on_map
    assert figures.open_set.gate.rule == 'p_right'
    assert 'report.html' in done('report', tmp_path / 'out')
    text = (tmp_path / 'out' / 'report' / 'report.md').read_text()
    assert 'stretches of 60 m of the road are mapped and left out by turns' in text
    assert f'| RingKey | {figures.open_set.on_map} | {figures.open_set.off_map} |' in text
    long = refused('evaluate', *named, '--leave-out-m', 500, '--out', tmp_path / 'long')
    assert 'leave_out_m: expected less than the path length of day_0, ' in long


def test_some_queries_are_aligned(street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str]) -> None:
    bags = [street_bag(f'day_{number}', count=32, noise_seed=number, lane_m=3.0 * number) for number in range(2)]
    named = ['--map', bags[0], '--query', bags[1], '--method', 'ring_key', '--cache', tmp_path / 'cache']
    done('evaluate', *named, '--out', tmp_path / 'none', '--no-pictures', '--alignments', 0)
    assert read_results(tmp_path / 'none' / 'results.json').alignments == {}
    output = done('evaluate', *named, '--out', tmp_path / 'some', '--no-pictures', '--alignments', 4)
    assert 'Alignments: pairs within 10 m' in output
    found = read_results(tmp_path / 'some' / 'results.json').alignments['own']['5']['ring_key']
    near = found.by_way['same way, other lane']
    assert 0 < near.pairs <= 4 * 5
    assert near.right == 1.0
    assert near.median_m < 0.5


def test_a_drive_off_the_map_has_no_recall(
    street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str]
) -> None:
    pytest.importorskip('matplotlib')
    pytest.importorskip('jinja2')
    day = street_bag('day', count=24)
    named = ['--map', day, '--query', day, '--exclusion-s', 60, '--method', 'ring_key', '--out', tmp_path]
    output = done('evaluate', *named, '--no-pictures')
    assert 'queries on the map, off it' in output
    assert 'Recall' not in output
    done('report', tmp_path)
    with (tmp_path / 'report' / 'tables' / 'gate_own_5m.csv').open(newline='') as file:
        (row,) = csv.DictReader(file)
    assert (row['on the map'], row['off it'], row['R@1 (%)'], row['answered on the map (%)']) == ('0', '24', '-', '-')
    with (tmp_path / 'report' / 'tables' / 'recognition_own_5m.csv').open(newline='') as file:
        (row,) = csv.DictReader(file)
    assert {row['R@1 (%)'], row['R@1 of all (%)'], row['AP']} == {'-'}


def test_a_recording_in_its_own_map_needs_an_exclusion(
    street_bag: Callable[..., Path], tmp_path: Path, refused: Callable[..., str]
) -> None:
    day = street_bag('day', count=4)
    assert 'expected --exclusion-s above 0' in refused(
        'evaluate', '--map', day, '--query', day, '--out', tmp_path / 'o'
    )


def test_drives_that_are_far_apart_are_refused(
    street_bag: Callable[..., Path], tmp_path: Path, refused: Callable[..., str]
) -> None:
    near, far = street_bag('near', count=4), street_bag('far', count=4, lane_m=400.0)
    output = refused('evaluate', '--map', near, '--query', far, '--method', 'ring_key', '--out', tmp_path / 'o')
    assert 'far: no scan within 25 m of near, the nearest 400 m away' in output


def test_recorded_scans_are_compared(
    street_bag: Callable[..., Path], tmp_path: Path, done: Callable[..., str], refused: Callable[..., str]
) -> None:
    bags = [street_bag(f'day_{number}', count=8, noise_seed=number) for number in range(2)]
    named = ['evaluate', '--map', bags[0], '--query', bags[1], '--method', 'ring_key', '--out', tmp_path / 'out']
    compared = ['--clean-scans', bags[0], '--compared-scans', f'rain={bags[1]}']
    output = done(*named, *compared, '--no-pictures')
    assert 'U of recorded scans' in output
    recorded = read_results(tmp_path / 'out' / 'results.json').recorded
    assert recorded is not None
    assert (recorded.clean, recorded.compared) == ('day_0', {'rain': 'day_1'})
    assert recorded.methods['ring_key']['rain'].scans == 8
    for wrong in (['--compared-scans', f'rain={bags[1]}'], [*compared, '--compared-scans', str(bags[1])]):
        assert 'expected NAME=RECORDING' in refused(*named, *wrong)
    assert 'no such folder' in refused(*named, '--clean-scans', tmp_path / 'gone')


def test_a_misspelt_method_is_named(tmp_path: Path, refused: Callable[..., str]) -> None:
    assert 'did you mean ring_key?' in refused('evaluate', '--method', 'rink_key', '--out', tmp_path)
    assert 'ring_key has no weights' in refused('evaluate', '--method', 'ring_key=compact', '--out', tmp_path)


def test_a_cache_that_is_a_file_is_named(
    street_bag: Callable[..., Path], tmp_path: Path, offradar: Callable[..., Any]
) -> None:
    (tmp_path / 'cache').write_text('')
    bags = [street_bag(f'day_{number}', count=4) for number in range(2)]
    named = ['--map', bags[0], '--query', bags[1], '--method', 'ring_key', '--cache', tmp_path / 'cache']
    ran = offradar('evaluate', *named, '--out', tmp_path / 'o')
    assert ran.status == 1
    assert 'expected a folder for embeddings (Not a directory)' in ran.err


def test_a_method_that_is_given_twice_is_refused(tmp_path: Path, refused: Callable[..., str]) -> None:
    twice = ['--method', 'ring_key', '--method', 'ring_key']
    assert 'expected each name once' in refused('evaluate', *twice, '--out', tmp_path)


def test_maps_need_queries(tmp_path: Path, refused: Callable[..., str]) -> None:
    assert 'protocol own: expected at least one --map and one --query' in refused('evaluate', '--map', tmp_path)
    assert 'expected at least one --map and one --query' in refused('evaluate', 'own', '--out', tmp_path / 'o')
    gone = ['--map', tmp_path / 'gone', '--query', tmp_path]
    assert f'{tmp_path / "gone"}: no such folder' in refused('evaluate', *gone, '--out', tmp_path / 'o')


def test_traversals_of_real_streets_are_mapped_and_searched_for(
    real_data: Path, tmp_path: Path, done: Callable[..., str]
) -> None:
    protocol = yaml.safe_load(shipped_file('protocols', 'mulran_simulated').read_text())
    protocol |= {'drive_spacing_m': 200.0, 'map_spacings_m': [200.0], 'tolerance_m': 150.0, 'negative_m': 150.0}
    protocol['validation'] |= {'cities': [2900001], 'scans': 5}
    (tmp_path / 'p.yaml').write_text(yaml.safe_dump(protocol))
    named = ['--streets', real_data / 'worlds', '--method', 'ring_key']
    done('evaluate', tmp_path / 'p.yaml', *named, '--out', tmp_path / 'out', '--no-pictures')
    results = read_results(tmp_path / 'out' / 'results.json')
    assert results.groups['streets']['200']['ring_key'].pairs == 12
    assert results.worlds == ('dcc', 'kaist')
    figures = results.maintenance['streets']['200']['ring_key']
    assert figures.ordered_pairs == 12
    assert results.scans('streets') == 'simulated scans'
