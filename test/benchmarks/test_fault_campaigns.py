"""A short run of each campaign of faults finds nothing; the page has the figures of a whole one that found nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('torch')

from fault_campaigns import CAMPAIGNS
from faults.page import read_record, tables

PROJECT = Path(__file__).resolve().parents[2]
SCALES = {'flips': 0.02, 'records': 0.02, 'kills': 0.04, 'power': 0.15, 'files': 1.0, 'messages': 0.13, 'soak': 0.2}
"""Share of the tries of `make faults`: about ten seconds each."""


@pytest.mark.parametrize('name', CAMPAIGNS)
def test_a_short_campaign_finds_nothing(name: str) -> None:
    if name == 'power' and shutil.which(os.environ.get('CC', 'cc')) is None:
        pytest.skip('a power cut is simulated from recorded writes, and the recorder needs a C compiler')
    command = [sys.executable, 'benchmarks/fault_campaigns.py', '--only', name, '--scale', str(SCALES[name])]
    environment = {**os.environ, 'PYTHONPATH': str(PROJECT)}
    ran = subprocess.run(
        command, cwd=PROJECT, env=environment, capture_output=True, text=True, timeout=500.0, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert 'seed 1' in ran.stdout


def test_the_page_has_the_figures_of_a_whole_run() -> None:
    record = read_record(PROJECT / 'benchmarks' / 'results' / 'faults.json')
    assert record['scale'] == 1.0
    assert {result['campaign'] for result in record['results']} == set(CAMPAIGNS)
    assert sum(result['differences'] + result['crashes'] + result['losses'] for result in record['results']) == 0
    assert tables(record) in (PROJECT / 'docs' / 'reliability.md').read_text(encoding='utf-8')
