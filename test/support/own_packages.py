"""Packages that offer encoders, as pip leaves them in a folder of packages."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / 'docs' / 'examples' / 'own_encoder' / 'own_encoder.py'


def write_package(site: Path, name: str, encoders: Mapping[str, str], source: str) -> None:
    """A package of one module, with entry points of the group of encoders."""
    (site / f'{name}.py').write_text(source, encoding='utf-8')
    info = site / f'{name}-0.1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {name}\nVersion: 0.1.0\n', encoding='utf-8')
    points = ''.join(f'{key} = {value}\n' for key, value in encoders.items())
    (info / 'entry_points.txt').write_text(f'[offradar_ros.encoders]\n{points}', encoding='utf-8')


@pytest.fixture
def own_encoder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The example of the documentation, installed for this process; its name."""
    site = tmp_path / 'packages'
    site.mkdir()
    write_package(site, 'own_encoder', {'median_rings': 'own_encoder:MedianRings'}, EXAMPLE.read_text(encoding='utf-8'))
    monkeypatch.syspath_prepend(str(site))
    return 'median_rings'
