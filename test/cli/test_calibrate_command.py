from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from offradar_ros.bags.sequence import BagSequence
from offradar_ros.config import load_config, read_parameters
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.types import PolarScan


def uncertainties(params: Path, scans: list[PolarScan]) -> np.ndarray:
    encoder = make_encoder(load_config(params).encoder)
    return np.array([encoder.encode(scan).uncertainty for scan in scans])


def test_u_is_1_on_average_and_delta_reaches_its_extremes(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    bag, params = street_bag('bag', count=8), tmp_path / 'calibrated.yaml'
    said = done('calibrate', bag, '--out', params)
    found = uncertainties(params, [BagSequence(bag).scan(i) for i in range(8)])
    assert found.mean() == pytest.approx(1.0, abs=1e-6)
    config = load_config(params)
    assert config.query.delta == pytest.approx(np.abs(found - 1.0).max(), abs=1e-6)
    assert config.query.level == config.query.levels
    assert said.startswith('8 of 8 scans: U 1.000 on average')


def test_a_recorded_drive(done: Callable[..., str], real_data: Path, tmp_path: Path) -> None:
    done('calibrate', real_data / 'radiate_tiny_foggy', '--out', tmp_path / 'params.yaml')
    done('convert', real_data / 'radiate_tiny_foggy', tmp_path / 'bag')
    bag = BagSequence(tmp_path / 'bag')
    found = uncertainties(tmp_path / 'params.yaml', [bag.scan(i) for i in range(len(bag))])
    assert found.mean() == pytest.approx(1.0, abs=1e-6)


def test_other_settings_of_the_encoder_are_kept(
    done: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path
) -> None:
    given, params = tmp_path / 'given.yaml', tmp_path / 'params.yaml'
    given.write_text('encoder: {ring_key: {rings: 32, variance_scale: 40.0}}\nquery: {levels: 4, level: 1}\n')
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
    assert done('calibrate', radiate_folder, '--out', tmp_path / 'params.yaml').startswith('4 of 5 scans')
    for frame in range(1, 6):
        cv2.imwrite(str(radiate_folder / 'Navtech_Polar' / f'{frame:06d}.png'), black)
    said = refused('calibrate', radiate_folder, '--out', tmp_path / 'none.yaml')
    assert 'city_1: expected at least one scan that can be encoded, got none' in said
    assert not (tmp_path / 'none.yaml').exists()


def test_bad_input_is_refused(refused: Callable[..., str], street_bag: Callable[..., Path], tmp_path: Path) -> None:
    bag, out = street_bag('bag', count=2), tmp_path / 'params.yaml'
    (tmp_path / 'bad.yaml').write_text('query: {delta: -1.0}')
    (tmp_path / 'learned.yaml').write_text('encoder: {name: variational}')
    assert 'the parameter file cannot be written' in refused('calibrate', bag, '--out', tmp_path / 'no' / 'params.yaml')
    assert 'the parameter file cannot be written' in refused('calibrate', bag, '--out', tmp_path)
    assert 'no such folder' in refused('calibrate', tmp_path / 'nothing', '--out', out)
    assert 'query.delta: expected at least 0' in refused(
        'calibrate', bag, '--out', out, '--params', tmp_path / 'bad.yaml'
    )
    assert 'encoder.weights' in refused('calibrate', bag, '--out', out, '--params', tmp_path / 'learned.yaml')
    assert 'not a readable YAML' in refused('calibrate', bag, '--out', out, '--params', tmp_path / 'none.yaml')
    assert not out.exists()
