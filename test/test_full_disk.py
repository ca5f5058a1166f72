"""On a full disk every writer says so in one line, and leaves the file that it would have replaced as it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bounded_process import REFUSED, refusal, run_bounded

from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.recordings.datasets.oxford_writer import write_oxford

FULL_AT = 600
"""Bytes that still fit."""

WRITERS = {
    'parameters': (
        'from offradar_ros.config import Config, parameters, write_parameters',
        'write_parameters(sys.argv[1], {leaf.name: leaf.value for leaf in parameters(Config())})',
    ),
    'weights': (
        'import numpy\nfrom offradar_ros.encoders.network_config import NetworkConfig\n'
        'from offradar_ros.encoders.weights import save_weights',
        "save_weights(sys.argv[1], NetworkConfig(backbone='compact'), {'a': numpy.zeros(999, numpy.float32)})",
    ),
    'codebook': (
        'import numpy\nfrom offradar_ros.encoders.rad_vlad_codebook import Codebook\n'
        'from offradar_ros.encoders.rad_vlad_rows import RowSettings',
        'Codebook(RowSettings(64.0), numpy.zeros((9, 257), numpy.float32), 0.5).save(sys.argv[1])',
    ),
    'confidence': (
        'from offradar_ros.config import ConfidenceConfig\n'
        'from offradar_ros.lab.evaluation.confidence import write_confidence',
        "write_confidence(Path(sys.argv[1]), ConfidenceConfig(), 'fitted ' + 'to much ' * 99)",
    ),
    'picture': (
        'from matplotlib.figure import Figure\nfrom offradar_ros.calibration.picture_file import save_picture',
        'save_picture(Figure(), sys.argv[1])',
    ),
    'record': (
        'from offradar_ros.config import Config\nfrom offradar_ros.records import write_record',
        'write_record(sys.argv[1], Config())',
    ),
    'log': (
        'from offradar_ros.lab.training.run_log import RunLog',
        'RunLog(Path(sys.argv[1]), 10**6)',
    ),
}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob('*') if path.is_file()}


@pytest.mark.parametrize('writer', WRITERS)
def test_a_file_is_as_it_was(tmp_path: Path, writer: str) -> None:
    imports, code = WRITERS[writer]
    if 'torch' in imports + code:
        pytest.importorskip('torch')
    path = tmp_path / 'old.png'
    line = json.dumps({'step': 1, 'loss': 0.5}) + '\n'
    path.write_text(line * 40)
    before = contents(tmp_path)
    assert 'File too large' in refusal(imports, code, path, file_bytes=FULL_AT)
    assert contents(tmp_path) == before


@pytest.mark.parametrize('write', ['write_bag', 'write_oxford'])
@pytest.mark.parametrize('full_at', [0, 1000, 20_000])
def test_a_recording_is_as_it_was(street: Callable[..., Any], tmp_path: Path, write: str, full_at: int) -> None:
    source = write_bag(street(count=4), tmp_path / 'source')
    out = (write_bag if write == 'write_bag' else write_oxford)(street(count=2), tmp_path / 'out')
    before = contents(tmp_path)
    imports = """
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.writer import BagOptions, write_bag
from offradar_ros.recordings.datasets.oxford_writer import write_oxford
"""
    call = {
        'write_bag': 'write_bag(BagSequence(sys.argv[1]), sys.argv[2], BagOptions(overwrite=True))',
        'write_oxford': 'write_oxford(BagSequence(sys.argv[1]), sys.argv[2], overwrite=True)',
    }
    assert 'cannot be written' in refusal(imports, call[write], source, out, file_bytes=full_at or 1)
    assert contents(tmp_path) == before


def test_parameters_that_are_calibrated_in_place_are_not_lost(street: Callable[..., Any], tmp_path: Path) -> None:
    bag, params = write_bag(street(count=6), tmp_path / 'bag'), tmp_path / 'car.yaml'
    params.write_text('encoder: {name: ring_key}\n# kept\n')
    before = params.read_bytes()
    status, printed = run_bounded(
        'from offradar_ros.cli.calibrate import calibrate',
        'calibrate(sources=[Path(sys.argv[1])], out=Path(sys.argv[2]), params=Path(sys.argv[2]))',
        bag,
        params,
        file_bytes=100,
    )
    assert status == REFUSED
    assert printed.splitlines()[-1] == f'{params}: the parameter file cannot be written (File too large)'
    assert params.read_bytes() == before


CACHED = """
drive = RecordedDrive('drive', sys.argv[1], 'world', (51.75, -1.25, 70.0), 0.0)
cached_drives([drive], Path(sys.argv[2]), processes=1)
"""


def test_drives_that_do_not_fit_leave_nothing(street: Callable[..., Any], tmp_path: Path) -> None:
    bag, cache = write_bag(street(count=4), tmp_path / 'bag'), tmp_path / 'cache'
    imports = """
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.recorded import RecordedDrive
"""
    assert 'the cache cannot be written' in refusal(imports, CACHED, bag, cache, file_bytes=5000)
    assert list(cache.iterdir()) == []


def test_embeddings_that_do_not_fit_leave_nothing(tmp_path: Path) -> None:
    imports = """
import numpy
from offradar_ros.lab.evaluation.embedding_cache import _write
"""
    path = tmp_path / 'embeddings.npy'
    assert 'File too large' in refusal(imports, '_write(Path(sys.argv[1]), numpy.zeros(999))', path, file_bytes=5000)
    assert list(tmp_path.iterdir()) == []
