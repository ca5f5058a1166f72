"""`offradar calibrate` over several drives of one road."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commands import RING_KEY

from offradar_ros.config import load_config, read_parameters
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.recordings.bags.writer import write_bag

COUNT = 120
EVERY = ('--spacing-m', '2.5')
KEPT = COUNT // 2
LOOSE = ('--error-rate', '0.2', '--off-map-rate', '0.1')


@pytest.fixture(scope='module')
def road(tmp_path_factory: pytest.TempPathFactory, street: Callable[..., Any]) -> list[Path]:
    """Three drives of 150 m along one street."""
    folder = tmp_path_factory.mktemp('road')
    drives = [street(count=COUNT, lane_m=1.0 * i, noise_seed=i, name=f'drive_{i}') for i in range(3)]
    return [write_bag(drive, folder / drive.name) for drive in drives]


@pytest.fixture
def paper(tmp_path: Path) -> Path:
    given = tmp_path / 'paper.yaml'
    given.write_text(
        'encoder: {name: ring_key}\nquery: {gate: paper, levels: 8, level: 8, top_k: 3}\nmap: {path: a.db}\n'
    )
    return given


def test_three_drives_give_a_probability_and_a_gate_that_are_used(
    done: Callable[..., str], road: list[Path], tmp_path: Path
) -> None:
    params, db, plot = tmp_path / 'params.yaml', tmp_path / 'map.db', tmp_path / 'plot.png'
    pytest.importorskip('matplotlib')
    printed = done('calibrate', *road, *RING_KEY, '--out', params, *EVERY, *LOOSE, '--plot', plot)
    assert printed.startswith(f'{3 * KEPT} scans of 3 drives, 0 refused; each is searched in both halves of the map')
    assert re.search(
        r'with confidence 0\.95, at most 0\.2 of the answers are wrong where at most 0\.\d+ of the', printed
    )
    assert 'at most 0.1 of the scans off the map are answered' in printed
    assert printed.splitlines()[-2:] == [f'{plot}: written', f'{params}: written']
    assert plot.read_bytes().startswith(b'\x89PNG')
    config = load_config(params)
    assert config.query.levels == 20
    fingerprint = make_encoder(config.encoder).info.fingerprint
    assert config.query.model == config.query.confidence.model == fingerprint
    assert f'min_probability {config.query.min_probability:g}: ' in printed
    assert params.read_text().startswith('# Written by offradar calibrate over 180 scans of drive_0, drive_1, drive_2.')
    done('drive', road[0], '--params', params, '--map', db, '--session', 'one')
    answered = done('drive', road[1], '--params', params, '--map', db)
    counts = {name: int(n) for name, n in re.findall(r'(match|rejected: \w+) +│ (\d+)', answered)}
    assert sum(counts.values()) == COUNT
    assert counts['match'] > COUNT // 4
    # Calibrated once more from its own file: the shipped coefficients are the prior again, not those of these drives.
    done('calibrate', *road, '--out', tmp_path / 'again.yaml', '--params', params, *EVERY, *LOOSE)
    again = load_config(tmp_path / 'again.yaml').query
    assert again.confidence.place_ratio == pytest.approx(config.query.confidence.place_ratio, rel=1e-3)


def test_with_the_paper_s_gate_the_promise_is_about_u(
    done: Callable[..., str], refused: Callable[..., str], road: list[Path], paper: Path, tmp_path: Path
) -> None:
    params = tmp_path / 'params.yaml'
    options = ['--params', paper, *EVERY, '--error-rate', '0.3', '--confidence', '0.9']
    printed = done('calibrate', *road[:2], '--out', params, *options)
    assert f'{2 * KEPT} scans of 2 drives' in printed
    assert 'U 1.000 on average' in printed
    assert 'at most 0.3 of the answers are wrong, with confidence 0.9 (of this level alone: ' in printed
    values = read_parameters(params)
    assert (values['query.levels'], values['query.top_k'], values['map.path']) == (8, 3, 'a.db')
    assert 'query.min_probability' not in values
    assert '--off-map-rate: expected query.gate: probability' in refused(
        'calibrate', *road[:2], '--out', params, *options, '--off-map-rate', '0.1'
    )


def test_promises_that_cannot_be_kept_are_refused_and_nothing_is_written(
    refused: Callable[..., str], road: list[Path], paper: Path, tmp_path: Path
) -> None:
    out = tmp_path / 'params.yaml'
    printed = refused('calibrate', *road, *RING_KEY, '--out', out, *EVERY)
    assert re.search(r'expected at least 368 scans that are off the map when a half is left out, got \d+', printed)
    rate = re.search(r'--off-map-rate (0\.\d+) or higher', printed)
    assert rate
    printed = refused(
        'calibrate', *road, *RING_KEY, '--out', out, *EVERY, '--off-map-rate', '0.1', '--error-rate', '0.01'
    )
    assert re.search(r'expected at least 368 answers, got \d+', printed)
    printed = refused('calibrate', *road, '--params', paper, '--out', out, *EVERY, '--error-rate', '0.01')
    assert 'expected at least 299 scans that can be answered, got 180' in printed
    assert not out.exists()


def test_drives_of_other_roads_are_refused(
    refused: Callable[..., str], road: list[Path], street: Callable[..., Any], tmp_path: Path
) -> None:
    out = tmp_path / 'params.yaml'
    aside = write_bag(street(count=4, lane_m=400.0, name='aside'), tmp_path / 'aside')
    assert 'drive_0: no scan within 25 m of another drive, the nearest 400 m away' in refused(
        'calibrate', road[0], aside, *RING_KEY, '--out', out
    )
    assert 'expected each folder once' in refused('calibrate', road[0], road[0], *RING_KEY, '--out', out)
    assert 'no such folder' in refused('calibrate', road[0], tmp_path / 'nothing', *RING_KEY, '--out', out)
    assert not out.exists()


def test_drives_without_positions_are_named(
    refused: Callable[..., str], road: list[Path], street: Callable[..., Any], tmp_path: Path
) -> None:
    lost = write_bag(street(count=4, name='lost').with_trajectory(None), tmp_path / 'lost')
    printed = refused('calibrate', road[0], lost, *RING_KEY, '--out', tmp_path / 'params.yaml')
    assert f'{lost}: expected positions beside the scans, and there are none' in printed


def test_a_plot_needs_several_drives_and_a_writable_file(
    offradar: Callable[..., Any], refused: Callable[..., str], road: list[Path], tmp_path: Path
) -> None:
    pytest.importorskip('matplotlib')
    out, nowhere = tmp_path / 'params.yaml', tmp_path / 'no' / 'p.png'
    printed = refused('calibrate', road[0], *RING_KEY, '--out', out, '--plot', tmp_path / 'p.png')
    assert '--plot: one drive has no wrong answers' in printed
    ran = offradar('calibrate', *road, *RING_KEY, '--out', out, '--plot', nowhere)
    assert ran.err == f'error: {nowhere}: cannot be written (No such file or directory)\n'
    printed = refused('calibrate', *road, *RING_KEY, '--out', out, *EVERY, *LOOSE, '--plot', tmp_path / 'p.doc')
    assert f"{tmp_path / 'p.doc'}: the plot cannot be written (Format 'doc' is not supported" in printed
    assert not out.exists()


def test_without_matplotlib_only_the_plot_is_refused(
    done: Callable[..., str],
    refused: Callable[..., str],
    road: list[Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr('importlib.util.find_spec', lambda name, *rest: None)
    options = [*RING_KEY, '--out', tmp_path / 'params.yaml', *EVERY, *LOOSE]
    assert "pip install '.[plot]'" in refused('calibrate', *road, *options, '--plot', tmp_path / 'p.png')
    done('calibrate', *road, *options)
