"""Training on a split: no scan of its test region or the buffer around it is used."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip('torch')

from typer.testing import CliRunner

from offradar_ros.cli.main import app
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.training.config import DataConfig
from offradar_ros.lab.training.config_file import read_config
from offradar_ros.lab.training.recorded_drives import recorded_drives, training_sequences
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.recordings.datasets.oxford_writer import write_oxford

SMOKE = Path(__file__).resolve().parents[3] / 'params' / 'train' / 'smoke.yaml'


@pytest.fixture
def data_set(tmp_path: Path, street: Callable[..., Any]) -> DataConfig:
    """Two of three training sequences, 24 scans 1.25 m apart from west to east, and a region around the 12th scan."""
    for number, name in enumerate(('monday', 'tuesday')):
        write_oxford(street(name=name, lane_m=float(number), noise_seed=number), tmp_path / 'data' / name)
    # Scan 12 is 15 m east of latitude 51.75°, longitude -1.25°.
    easting_m, northing_m = 620_802.167 + 15.0, 5_734_682.084
    text = f"""
name: street
title: Street
source: made for this test
test: [friday]
train: [monday, tuesday, sunday]
region: {{epsg: 32630, circles: [{{easting_m: {easting_m}, northing_m: {northing_m}, radius_m: 3.0}}]}}
buffer_m: 2.2
"""
    (tmp_path / 'street.yaml').write_text(text)
    return DataConfig(split=str(tmp_path / 'street.yaml'), root=str(tmp_path / 'data'), sequence_spacing_m=0.0)


def test_scans_of_the_region_and_its_buffer_are_left_out(data_set: DataConfig, street: Callable[..., Any]) -> None:
    drives = recorded_drives(data_set)
    assert [drive.name for drive in drives] == ['monday', 'tuesday']
    assert len({drive.world for drive in drives}) == 1
    for lane_m, drive in enumerate(drives):
        east_m = 1.25 * np.arange(24)
        expected = np.flatnonzero(np.hypot(east_m - 15.0, lane_m) > 5.2)
        assert 0 < len(expected) < 24
        np.testing.assert_array_equal(drive.open().stamps_ns, street().stamps_ns[expected])


def test_sequences_of_a_split_may_be_bags(data_set: DataConfig, street: Callable[..., Any]) -> None:
    root = Path(data_set.root)
    write_bag(street(name='sunday', lane_m=1.0), root / 'sunday')
    monday, tuesday, sunday = recorded_drives(data_set)
    assert len({drive.world for drive in (monday, tuesday, sunday)}) == 1
    np.testing.assert_array_equal(sunday.open().stamps_ns, tuesday.open().stamps_ns)


def test_missing_sequences_are_listed(data_set: DataConfig) -> None:
    found = training_sequences(data_set)
    assert found is not None
    assert found.missing == ['sunday']
    assert [folder.name for folder in found.found] == ['monday', 'tuesday']


def test_without_a_split_there_are_no_sequences() -> None:
    assert training_sequences(DataConfig()) is None
    assert recorded_drives(DataConfig()) == []


def test_a_split_without_data_is_an_error_of_one_line(data_set: DataConfig, tmp_path: Path) -> None:
    (tmp_path / 'empty').mkdir()
    for changes, message in (
        ({'root': ''}, 'key data.root: expected the folder that holds the sequences of split street'),
        ({'root': str(tmp_path / 'nowhere')}, 'nowhere: no such folder: expected the sequences of split street'),
        ({'root': str(tmp_path / 'empty')}, 'none of the 3 training sequences of split street is there'),
        ({'split': 'oxfrod'}, 'oxfrod: expected a YAML file or one of the splits'),
        ({'split': ''}, 'key data.split: expected the split whose sequences are in data.root'),
    ):
        paths = {'split': data_set.split, 'root': data_set.root, **changes}
        with pytest.raises((ConfigError, DataError), match=message):
            training_sequences(DataConfig(split=paths['split'], root=paths['root']))


def test_a_sequence_within_the_region_is_an_error(data_set: DataConfig) -> None:
    split = Path(data_set.split)
    split.write_text(split.read_text().replace('radius_m: 3.0', 'radius_m: 300.0'))
    with pytest.raises(DataError, match='monday: no scan has a position outside the test region'):
        recorded_drives(data_set)[0].open()


@pytest.mark.timeout(900)
def test_a_run_trains_on_the_split_and_reports_missing_sequences(data_set: DataConfig, tmp_path: Path) -> None:
    settings = ['data.worlds=0', f'data.split={data_set.split}', f'data.root={data_set.root}', 'steps=2']
    settings += ['validation.worlds=0', 'batch.places=2', 'batch.negative_m=3', 'batch.positive_m=1.5']
    assert read_config(SMOKE, settings).data.split == data_set.split
    chosen = [text for setting in settings for text in ('--set', setting)]
    out = tmp_path / 'out'
    done = CliRunner().invoke(app, ['train', '--config', str(SMOKE), '--out', str(out), '--device', 'cpu', *chosen])
    assert done.exit_code == 0, done.output
    assert '1 of 3 training sequences of split' in done.output
    assert done.output.count('sunday') == 1
    record = json.loads((out / 'run.jsonl').read_text().splitlines()[0])
    assert record['drives'] == 2
    assert record['scans'] == sum(len(drive.open()) for drive in recorded_drives(data_set))


@pytest.mark.timeout(900)
def test_a_run_trains_on_bags(street_bag: Callable[..., Path], tmp_path: Path) -> None:
    bags = [str(street_bag(name, lane_m=lane_m, noise_seed=7)) for name, lane_m in (('first', 0.0), ('second', 1.0))]
    settings = ['data.worlds=0', f'data.sequences=[{", ".join(bags)}]', 'steps=2', 'validation.worlds=0']
    settings += ['batch.places=2', 'batch.negative_m=3', 'batch.positive_m=1.5']
    chosen = [text for setting in settings for text in ('--set', setting)]
    out = tmp_path / 'out'
    done = CliRunner().invoke(app, ['train', '--config', str(SMOKE), '--out', str(out), '--device', 'cpu', *chosen])
    assert done.exit_code == 0, done.output
    record = json.loads((out / 'run.jsonl').read_text().splitlines()[0])
    # A drive of 24 scans 1.25 m apart; data.sequence_spacing_m is 1 m.
    assert (record['drives'], record['scans']) == (2, 48)
