"""Recorded traversals as drives: positions, regions, and missing recordings."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from street_sequence import ORIGIN, StreetSequence

from offradar_ros.errors import ConfigError, DataError, RefusedInput
from offradar_ros.geometry import LocalFrame, geodetic_to_utm
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.evaluate import Options, encode_drives, evaluate
from offradar_ros.lab.evaluation.protocol import Group, Protocol, Recorded, Validation
from offradar_ros.lab.evaluation.recorded_drives import RecordedSource, recorded_drives
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.recordings.datasets.oxford_writer import write_oxford


def protocol_of(*roads: Recorded, **changes: object) -> Protocol:
    settings = {'drive_spacing_m': 0.0, 'map_spacings_m': (0.0,), 'tolerance_m': 3.0, 'negative_m': 6.0, 'resamples': 5}
    return Protocol('p', 'P', (Group('g', 'G', recorded=roads),), **{**settings, **changes})  # type: ignore[arg-type]


@pytest.fixture(scope='module')
def data(tmp_path_factory: pytest.TempPathFactory, street: Callable[..., StreetSequence]) -> Path:
    """Three drives of one street, 30 m long, and a fourth on another road."""
    root = tmp_path_factory.mktemp('data')
    for number, lane_m in enumerate((0.0, 1.5, -1.0)):
        drive = street(count=24, lane_m=lane_m, noise_seed=number, name=f'd{number}')
        write_oxford(drive, root / f'd{number}')
    write_bag(street(count=24, lane_m=300.0, noise_seed=9), root / 'elsewhere')
    return root


def opened(data: Path, protocol: Protocol) -> list[Drive]:
    return recorded_drives(protocol, RecordedSource(data)).drives


def test_poses_are_where_the_scans_were_taken(data: Path) -> None:
    first, second = opened(data, protocol_of(Recorded('r', sequences=('d0', 'd1'))))
    # The frame starts at the first position of the first drive, a second and 5 m before its first scan.
    np.testing.assert_allclose(first.poses[:, 0], 5.0 + 1.25 * np.arange(24), atol=0.05)
    np.testing.assert_allclose(second.poses[:, 1] - first.poses[:, 1], 1.5, atol=0.05)
    np.testing.assert_allclose(np.diff(first.driven_m), 1.25, atol=0.05)
    assert np.isnan(first.severities).all()
    assert set(first.kinds) == {''}
    assert [drive.name for drive in (first, second)] == ['d0', 'd1']
    assert first.scan(3).power.shape == (400, 576)
    assert first.key != second.key


def test_scans_are_subsampled_by_distance_driven(data: Path) -> None:
    (drive, _) = opened(data, protocol_of(Recorded('r', sequences=('d0', 'd1')), drive_spacing_m=5.0))
    assert len(drive) == 6
    np.testing.assert_allclose(np.diff(drive.driven_m), 5.0, atol=1.25)


def test_a_road_is_mapped_and_searched_as_named(data: Path) -> None:
    drives = opened(data, protocol_of(Recorded('r', maps=('d0',), queries=('d1', 'd2'))))
    assert [(d.mapped, d.queried) for d in drives] == [(True, False), (False, True), (False, True)]


def test_only_scans_in_the_test_region_of_a_split_are_kept(data: Path, tmp_path: Path) -> None:
    centre = LocalFrame(ORIGIN).to_geodetic(np.array([[10.0, 0.0, 0.0]]))
    easting_m, northing_m, _ = geodetic_to_utm(centre, 32630)[0].tolist()
    circle = {'northing_m': northing_m, 'easting_m': easting_m, 'radius_m': 6.0}
    split = {
        'name': 's',
        'title': 'S',
        'source': 'made up',
        'test': ['d0', 'd1'],
        'train': ['d2'],
        'region': {'epsg': 32630, 'circles': [circle]},
    }
    (tmp_path / 's.yaml').write_text(json.dumps(split))
    (drive, _) = opened(data, protocol_of(Recorded('r', split=str(tmp_path / 's.yaml'))))
    # Scan k is 1.25 k metres east of the origin: those of 4 m to 16 m.
    np.testing.assert_allclose(drive.poses[:, 0] - 5.0, 1.25 * np.arange(4, 13), atol=0.05)
    split['region']['circles'][0]['northing_m'] += 5000.0  # type: ignore[index]
    (tmp_path / 's.yaml').write_text(json.dumps(split))
    found = recorded_drives(protocol_of(Recorded('r', split=str(tmp_path / 's.yaml'))), RecordedSource(data))
    assert found.drives == []
    assert [text.split(' of ')[0] for text in found.notes] == [
        f'{n}: no scan is in the test region' for n in ('d0', 'd1')
    ]


def test_missing_recordings_are_noted_and_the_others_are_opened(data: Path) -> None:
    protocol = protocol_of(Recorded('r', sequences=('d0', 'gone', 'd2')), validation=Validation(sequences=('lost',)))
    found = recorded_drives(protocol, RecordedSource(data))
    assert [drive.name for drive in found.drives] == ['d0', 'd2']
    assert found.notes == [f'r: not found: gone in {data}', f'lost: not found in {data}: no validation on it']
    alone = recorded_drives(protocol_of(Recorded('r', sequences=('d0', 'gone'))), RecordedSource(data))
    assert alone.drives == []
    within = protocol_of(Recorded('r', sequences=('d0', 'gone')), exclusion_s=2.0)
    assert [drive.name for drive in opened(data, within)] == ['d0']


def test_validation_takes_scans_at_equal_steps_with_or_without_positions(data: Path) -> None:
    road = Recorded('r', sequences=('d0', 'd1'))
    *_, clean = opened(data, protocol_of(road, validation=Validation(sequences=('d2',), scans=4)))
    assert (clean.group, len(clean), clean.mapped) == ('validation', 4, False)
    np.testing.assert_array_equal(np.diff(clean.stamps_ns) // 250_000_000, [8, 7, 8])


def test_an_unreadable_scan_is_refused(data: Path, tmp_path: Path, street: Callable[..., StreetSequence]) -> None:
    for name in ('a', 'b'):
        write_oxford(street(count=6), tmp_path / name)
    damaged = sorted((tmp_path / 'a' / 'radar').iterdir())[2]
    damaged.write_bytes(damaged.read_bytes()[:500])
    (drive, _) = opened(tmp_path, protocol_of(Recorded('r', sequences=('a', 'b'))))
    with pytest.raises(RefusedInput, match=damaged.name):
        drive.scan(2)
    options = quiet_options(tmp_path / 'out', tmp_path)
    encoded = encode_drives(protocol_of(Recorded('r', sequences=('a', 'b'))), ['ring_key'], options)
    assert [(m.method, m.drives, m.scans, m.refused) for m in encoded] == [('ring_key', 2, 12, 1)]


def quiet_options(out: Path, data: Path) -> Options:
    class Bar:
        def __init__(self, text: str) -> None: ...

        def __enter__(self) -> Callable[[int, int], None]:
            return lambda done, total: None

        def __exit__(self, *error: object) -> None: ...

    return Options(out, out / 'cache', 'offradar evaluate …', Bar, recorded=RecordedSource(data), pictures=False)


def test_every_drive_of_a_recorded_road_is_mapped_and_searched_for(data: Path, tmp_path: Path) -> None:
    protocol = protocol_of(Recorded('r', sequences=('d0', 'd1', 'd2')), validation=Validation(sequences=('d2',)))
    results = evaluate(protocol, ['ring_key'], quiet_options(tmp_path, data))
    figures = results.groups['g']['0']['ring_key']
    assert (figures.pairs, figures.queries, figures.with_positive) == (6, 144, 144)
    # The reflectors look similar from the next lane: most scans are found, but not all.
    assert figures.recall_at_1.value > 0.8
    assert np.isnan(figures.recall_at_1_clean.value)
    assert results.maintenance['g']['0']['ring_key'].ordered_pairs == 6
    assert results.scans('g') == 'recorded scans'
    drives = [(drive.group, drive.name, drive.scans) for drive in results.drives]
    assert drives == [('g', 'd0', 24), ('g', 'd1', 24), ('g', 'd2', 24), ('validation', 'd2_1', 24)]
    assert results.skipped == ()


def test_drives_of_different_roads_are_reported(data: Path, tmp_path: Path) -> None:
    away = 'the nearest 300 m away: other roads, or positions that do not agree'
    with pytest.raises(DataError, match=f'^elsewhere: no scan within 3 m of d0, {away}$'):
        evaluate(protocol_of(Recorded('r', sequences=('d0', 'elsewhere'))), ['ring_key'], quiet_options(tmp_path, data))
    road = Recorded('r', maps=('d0',), queries=('d1', 'elsewhere'))
    results = evaluate(protocol_of(road), ['ring_key'], quiet_options(tmp_path, data))
    assert results.skipped == (f'elsewhere: no scan within 3 m of d0, {away}',)
    assert results.groups['g']['0']['ring_key'].with_positive == 24


def test_folders_of_one_name_have_different_names_in_results(
    data: Path, tmp_path: Path, street: Callable[..., StreetSequence]
) -> None:
    write_bag(street(count=6), tmp_path / 'd0')
    drives = opened(data, protocol_of(Recorded('r', sequences=('d0', str(tmp_path / 'd0')))))
    assert [drive.name for drive in drives] == [f'{data.name}/d0', f'{tmp_path.name}/d0']


def test_nothing_to_search_is_one_line(data: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match='expected two drives of a road or more, found none; r: not found: x, y'):
        evaluate(protocol_of(Recorded('r', sequences=('x', 'y'))), ['ring_key'], quiet_options(tmp_path, data))


def test_positions_of_two_kinds_are_not_compared(
    data: Path, tmp_path: Path, street: Callable[..., StreetSequence]
) -> None:
    drive = street(count=6)
    write_bag(drive, tmp_path / 'a')
    write_bag(drive.with_trajectory(drive.trajectory.in_frame(LocalFrame(ORIGIN))), tmp_path / 'b')
    with pytest.raises(DataError, match='they cannot be compared'):
        opened(tmp_path, protocol_of(Recorded('r', sequences=('a', 'b'))))
