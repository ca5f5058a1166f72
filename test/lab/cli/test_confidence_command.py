"""`offradar confidence`, from a protocol to coefficients that the query node reads."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from offradar_ros.cli.main import app
from offradar_ros.config import ConfidenceConfig, EncoderConfig
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.records import read_record
from offradar_ros.retrieval.confidence import TERMS

PROTOCOL = """
name: tiny
title: Two tiny cities
groups:
  - {name: a, title: A, physics: drawn, cities: [2999994, 2999995]}
lanes: [{}, {left_m: 1.0}]
scans: 16
map_spacings_m: [5.0, 15.0]
"""


def test_coefficients_are_written_for_the_model_of_the_method(tmp_path: Path) -> None:
    protocol, out = tmp_path / 'tiny.yaml', tmp_path / 'ring_key.yaml'
    protocol.write_text(PROTOCOL)
    options = ['--method', 'ring_key', '--cache', str(tmp_path / 'cache'), '--processes', '1', '--out', str(out)]
    done = CliRunner().invoke(app, ['confidence', str(protocol), *options], catch_exceptions=False)
    assert done.exit_code == 0
    found = read_record(ConfidenceConfig, out)
    assert found.model == make_encoder(EncoderConfig(name='ring_key', weights='')).info.fingerprint
    assert all(getattr(found, name) <= 0.0 for name in TERMS)
    assert any(getattr(found, name) < 0.0 for name in TERMS)
    assert 'nearest place' in out.read_text()


def test_a_method_that_is_fitted_to_each_map_is_refused(tmp_path: Path) -> None:
    protocol = tmp_path / 'tiny.yaml'
    protocol.write_text(PROTOCOL)
    command = ['confidence', str(protocol), '--method', 'rad_vlad', '--cache', str(tmp_path), '--out']
    done = CliRunner().invoke(app, [*command, str(tmp_path / 'out.yaml')])
    assert done.exit_code != 0
    assert 'not fitted to each map' in str(done.exception)
