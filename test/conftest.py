"""Fixtures for the whole suite."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from street_sequence import StreetSequence

from offradar_ros.recordings.bags.writer import write_bag

pytest_plugins = ('commands', 'own_packages', 'ros_domain')

# A busy machine must not fail a test.
settings.register_profile('any_machine', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('any_machine')

PROJECT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope='session')
def real_data() -> Path:
    """Folder of recorded scans that may not be redistributed; tests that need it skip where it is absent."""
    folder = Path(os.environ.get('OFFRADAR_REAL_DATA', PROJECT.parent / 'shared' / 'real'))
    if not folder.is_dir():
        pytest.skip(f'no recorded data at {folder}: set OFFRADAR_REAL_DATA to the folder that holds it')
    return folder


@pytest.fixture(scope='session')
def street() -> Callable[..., StreetSequence]:
    return StreetSequence


@pytest.fixture
def street_bag(tmp_path: Path, street: Callable[..., StreetSequence]) -> Callable[..., Path]:
    """Writes a drive as a bag: `street_bag('name', count=…)`."""

    def write(name: str, **options: Any) -> Path:
        return write_bag(street(**options), tmp_path / name)

    return write
