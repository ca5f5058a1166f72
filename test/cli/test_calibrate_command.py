from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from commands import RING_KEY

from offradar_ros.config import load_config, read_parameters, write_parameters
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.retrieval.thresholds import threshold_at
from offradar_ros.types import PolarScan


def uncertainties(params: Path, scans: list[PolarScan]) -> np.ndarray:
    encoder = make_encoder(load_config(params).encoder)
    return np.array([encoder.encode(scan).uncertainty for scan in scans])


def test_u_is_1_on_average_and_delta_reaches_its_extremes(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag, params = street_bag('bag', count=8), tmp_path / 'calibrated.yaml'
    printed = done('calibrate', bag, *RING_KEY, '--out', params)
    found = uncertainties(params, [BagSequence(bag).scan(i) for i in range(8)])
    assert found.mean() == pytest.approx(1.0, abs=1e-6)
    config = load_config(params)
    assert config.query.delta == pytest.approx(np.abs(found - 1.0).max(), abs=2e-6)
    assert config.query.level == config.query.levels == 20
    assert found.max() <= threshold_at(config.query)
    assert printed.startswith('8 of 8 scans: U 1.000 on average')


def test_a_recorded_drive(done: Callable[..., str], real_data: Path, tmp_path: Path) -> None:
    done('calibrate', real_data / 'radiate_tiny_foggy', *RING_KEY, '--out', tmp_path / 'params.yaml')
    done('convert', real_data / 'radiate_tiny_foggy', tmp_path / 'bag')
    bag = BagSequence(tmp_path / 'bag')
    found = uncertainties(tmp_path / 'params.yaml', [bag.scan(i) for i in range(len(bag))])
    assert found.mean() == pytest.approx(1.0, abs=1e-6)


def test_other_settings_of_the_encoder_are_kept(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    given, params = tmp_path / 'given.yaml', tmp_path / 'params.yaml'
    given.write_text(
        'encoder: {name: ring_key, ring_key: {rings: 32, variance_scale: 40.0}}\nquery: {levels: 4, level: 1}\n'
    )
    bag = street_bag('bag', count=4)
    done('calibrate', bag, '--out', params, '--params', given)
    config = load_config(params)
    assert (config.encoder.ring_key.rings, config.query.levels, config.query.level) == (32, 4, 4)
    found = uncertainties(params, [BagSequence(bag).scan(i) for i in range(4)])
    assert found.mean() == pytest.approx(1.0, abs=1e-6)
    # Calibrated once more, nothing changes.
    done('calibrate', bag, '--out', tmp_path / 'again.yaml', '--params', params)
    first, again = read_parameters(params), read_parameters(tmp_path / 'again.yaml')
    assert again.keys() == first.keys()
    assert again['encoder.ring_key.variance_scale'] == pytest.approx(first['encoder.ring_key.variance_scale'])


def test_scans_that_are_refused_are_left_out(
    done: Callable[..., str], refused: Callable[..., str], radiate_folder: Path, tmp_path: Path
) -> None:
    black = np.zeros((576, 400), np.uint8)
    cv2.imwrite(str(radiate_folder / 'Navtech_Polar' / '000002.png'), black)
    assert done('calibrate', radiate_folder, *RING_KEY, '--out', tmp_path / 'params.yaml').startswith('4 of 5 scans')
    for frame in range(1, 6):
        cv2.imwrite(str(radiate_folder / 'Navtech_Polar' / f'{frame:06d}.png'), black)
    printed = refused('calibrate', radiate_folder, *RING_KEY, '--out', tmp_path / 'none.yaml')
    assert 'city_1: expected at least 2 scans that can be encoded, got 0; 5 of 5 scans refused: no_signal: ' in printed
    assert not (tmp_path / 'none.yaml').exists()


def test_the_causes_are_named_where_nothing_can_be_encoded(
    refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    given = tmp_path / 'given.yaml'
    given.write_text('radar: {profile: custom}\n')
    printed = refused('calibrate', street_bag('bag', count=3), '--out', tmp_path / 'out.yaml', '--params', given)
    assert '3 of 3 scans refused: unknown_range_resolution: ' in printed
    assert 'radar.range_resolution_m' in printed


def test_one_scan_is_too_few_and_few_are_noted(
    done: Callable[..., str], refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    out = tmp_path / 'out.yaml'
    printed = refused('calibrate', street_bag('one', count=1), *RING_KEY, '--out', out)
    assert 'expected at least 2 scans that can be encoded, got 1' in printed
    lines = done('calibrate', street_bag('few', count=3), *RING_KEY, '--out', out).splitlines()
    assert lines[1].endswith('0 of these scans, and one more like them with a chance of at most 0.2500')
    assert lines[2].startswith('note: 3 scans are too few to reject 0.01 of ordinary ones (99 are enough)')
    assert lines[3].startswith('note: nothing is known of wrong answers')
    assert lines[4].startswith('probability: the shipped coefficients are kept, with a usual U of ')
    assert lines[5:] == [f'{out}: written']
    again = done(
        'calibrate', street_bag('more', count=20), *RING_KEY, '--out', out, '--reject-at-most', '0.05'
    ).splitlines()
    assert len(again) == 5
    assert again[4] == f'{out}: replaced'


def test_the_threshold_is_the_lowest_static_one_that_rejects_few_enough(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag, params = street_bag('bag', count=40, degraded=(3, 17, 30)), tmp_path / 'params.yaml'
    printed = done('calibrate', bag, *RING_KEY, '--out', params, '--reject-at-most', '0.2', '--levels', '50')
    found = np.sort(uncertainties(params, [BagSequence(bag).scan(i) for i in range(40)]))
    query = load_config(params).query
    # The 33rd of 40: ⌈41 · 0.8⌉.
    assert query.levels == 50
    assert threshold_at(query) >= found[32] > threshold_at(dataclasses.replace(query, level=query.level - 1))
    rejected = int(np.sum(found > threshold_at(query)))
    assert 3 <= rejected <= 7
    assert f'{rejected} of these scans, and one more like them with a chance of at most 0.2000' in printed


def test_the_parameters_name_the_model_that_they_are_for(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag, params, db = street_bag('bag', count=6), tmp_path / 'params.yaml', tmp_path / 'map.db'
    done('calibrate', bag, *RING_KEY, '--out', params)
    config = load_config(params)
    assert config.query.model == make_encoder(config.encoder).info.fingerprint
    assert 'map_empty' in done('drive', bag, '--params', params, '--map', db, '--session', 'one')
    assert 'match' in done('drive', bag, '--params', params, '--map', db)
    # The same thresholds with another scale of U, and so of another model.
    values = read_parameters(params)
    write_parameters(params, values | {'encoder.ring_key.variance_scale': 1.0})
    printed = done('drive', bag, '--params', params, '--map', tmp_path / 'other.db', '--session', 'one')
    assert 'rejected: wrong_model │ 6' in printed


def test_every_other_parameter_of_the_file_is_kept(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    params = tmp_path / 'my.yaml'
    params.write_text(
        '/**:\n  ros__parameters:\n    use_sim_time: true\n'
        '    radar: {range_resolution_m: 0.17, azimuth_offset_rad: 1}\n'
        '    position: {source: odometry, max_gap_s: 3}\n    query: {top_k: 9, delta: 0.1}\n    map: {path: town.db}\n'
        '    qos_overrides: {/gps/fix: {subscription: {depth: 3}}}\n'
    )
    before = read_parameters(params)
    done('calibrate', street_bag('bag', count=3), '--out', params, '--params', params)
    after = read_parameters(params)
    new = {name for name in after if name not in before}
    assert all(name.startswith(('encoder.', 'query.confidence.', 'query.level', 'query.model')) for name in new)
    assert {name for name in before if after[name] != before[name]} == {'query.delta'}
    # Nodes refuse a whole number where they want a decimal one.
    assert isinstance(after['position.max_gap_s'], float)
    assert isinstance(after['radar.azimuth_offset_rad'], float)


def test_a_file_that_cannot_be_written_is_refused_before_the_work(
    offradar: Callable[..., Any], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    ran = offradar('calibrate', street_bag('bag', count=2), *RING_KEY, '--out', tmp_path / 'no' / 'params.yaml')
    assert ran.status == 1
    assert 'encoding' not in ran.err


def test_bad_input_is_refused(refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path) -> None:
    bag, out = street_bag('bag', count=2), tmp_path / 'params.yaml'
    (tmp_path / 'bad.yaml').write_text('query: {delta: -1.0}')
    (tmp_path / 'learned.yaml').write_text("encoder: {name: variational, weights: ''}")
    assert 'cannot be written' in refused('calibrate', bag, *RING_KEY, '--out', tmp_path / 'no' / 'params.yaml')
    assert 'cannot be written' in refused('calibrate', bag, *RING_KEY, '--out', tmp_path)
    assert 'no such folder' in refused('calibrate', tmp_path / 'nothing', *RING_KEY, '--out', out)
    assert 'query.delta: expected at least 0' in refused(
        'calibrate', bag, '--out', out, '--params', tmp_path / 'bad.yaml'
    )
    assert 'encoder.weights' in refused('calibrate', bag, '--out', out, '--params', tmp_path / 'learned.yaml')
    assert 'none.yaml: no such file' in refused('calibrate', bag, '--out', out, '--params', tmp_path / 'none.yaml')
    assert not out.exists()
