"""Ratios of a new run compared with the committed ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import check_ratios
import pytest

COMMITTED: dict[str, Any] = {
    'machine': {'cores': 2},
    'search': {'ratio_to_reading': {'5': 1.1, '25': 1.1}},
    'encoders': {'compact': {'median_ms': 10.0, 'ratio_to_network': 2.0}, 'ring_key': {'ratio_to_network': 1.5}},
}


def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fresh: dict[str, Any], name: str = 'pipeline.json') -> int:
    for folder, record, file in (('fresh', fresh, name), ('committed', COMMITTED, 'pipeline.json')):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / file).write_text(json.dumps(record))
    words = ['check_ratios.py', str(tmp_path / 'fresh'), '--committed', str(tmp_path / 'committed'), '--slack', '0.2']
    monkeypatch.setattr('sys.argv', words)
    return check_ratios.main()


def changed(**values: float) -> dict[str, Any]:
    compact = {**COMMITTED['encoders']['compact'], **values}
    return {**COMMITTED, 'encoders': {**COMMITTED['encoders'], 'compact': compact}}


def test_times_may_differ_ratios_may_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, monkeypatch, changed(median_ms=100.0, ratio_to_network=2.3)) == 0
    assert '4 ratios compared, 0 missing, or grown' in capsys.readouterr().out


def test_a_ratio_that_has_grown_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, monkeypatch, changed(ratio_to_network=2.5)) == 1
    output = capsys.readouterr().out
    assert 'WRONG encoders.compact.ratio_to_network: 2.5, committed 2' in output
    assert '4 ratios compared, 1 missing, or grown' in output


def test_a_ratio_inside_a_table_of_ratios_is_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(tmp_path, monkeypatch, {**COMMITTED, 'search': {'ratio_to_reading': {'5': 1.5, '25': 1.1}}}) == 1


@pytest.mark.parametrize('search', [{}, {'ratio_to_reading': {'5': float('nan'), '25': 1.1}}])
def test_a_ratio_that_is_missing_or_nan_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, search: dict[str, Any]
) -> None:
    assert run(tmp_path, monkeypatch, {**COMMITTED, 'search': search}) == 1


def test_a_large_committed_ratio_is_not_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(COMMITTED, 'search', {'ratio_to_reading': {'5': 15.0}})
    assert run(tmp_path, monkeypatch, {**COMMITTED, 'search': {'ratio_to_reading': {'5': 30.0}}}) == 0


def test_a_smaller_ratio_passes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(tmp_path, monkeypatch, changed(ratio_to_network=0.5)) == 0


def test_no_common_results_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path, monkeypatch, COMMITTED, name='other.json') == 2
    assert 'expected results that are also in' in capsys.readouterr().err


@pytest.mark.parametrize('name', ['pipeline', 'encoders', 'search'])
def test_committed_results_hold_ratios(name: str) -> None:
    assert list(check_ratios.ratios(json.loads((check_ratios.COMMITTED / f'{name}.json').read_text())))
