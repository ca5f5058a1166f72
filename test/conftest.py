"""Fixtures for the whole suite."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope='session')
def real_data() -> Path:
    """Folder of recorded scans that may not be redistributed; tests that need it skip where it is absent."""
    folder = Path(os.environ.get('OFFRADAR_REAL_DATA', PROJECT.parent / 'shared' / 'real'))
    if not folder.is_dir():
        pytest.skip(f'no recorded data at {folder}: set OFFRADAR_REAL_DATA to the folder that holds it')
    return folder
