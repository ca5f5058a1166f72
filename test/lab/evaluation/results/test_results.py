"""Results and their arrays are read as they were written; other files are refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from street_evaluation import StreetEvaluation

from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.results.ablation import AblationFigures
from offradar_ros.lab.evaluation.results.alignments import AlignmentFigures
from offradar_ros.lab.evaluation.results.arrays import SCANS, map_arrays, read_arrays, scan_rows, write_arrays
from offradar_ros.lab.evaluation.results.file import FORMAT, read_results, write_results
from offradar_ros.lab.evaluation.results.method import MethodRecord
from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.results.uncertainty import RecordedUncertainty, UncertaintyFigures
from offradar_ros.lab.evaluation.stored_record import StoredFormat


def test_results_are_read_as_written(street_evaluation: StreetEvaluation, tmp_path: Path) -> None:
    results, path = street_evaluation.results, tmp_path / 'results.json'
    write_results(path, results)
    found = read_results(path)
    # repr writes every digit, and NaN as such.
    assert repr(found) == repr(results)
    assert json.loads(path.read_text())['methods']['ours']['cost']['search_ms'] is None


RECORDS = (SearchFigures, AblationFigures, AlignmentFigures, UncertaintyFigures, RecordedUncertainty, MethodRecord)


@pytest.mark.parametrize('kind', RECORDS)
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_any_record_is_read_as_written(
    kind: type, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp('records')
    stored: StoredFormat[Any] = StoredFormat(kind, 'test', 1, 'a test', 'test again')
    stored.write(folder / 'first.json', data.draw(st.builds(kind)))
    stored.write(folder / 'second.json', stored.read(folder / 'first.json'))
    assert (folder / 'first.json').read_bytes() == (folder / 'second.json').read_bytes()


@pytest.mark.parametrize('content', ['{}', 'no json', '[1]', '{"format": "offradar-card-1"}', '{"format": 3}'])
def test_a_file_without_results_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / 'r.json'
    path.write_text(content)
    with pytest.raises(DataError, match=r'expected the results\.json') as refused:
        read_results(path)
    assert str(refused.value).startswith(f'{path}: ')


def test_results_without_alignments_are_read(street_evaluation: StreetEvaluation, tmp_path: Path) -> None:
    """As versions before them wrote it."""
    path = tmp_path / 'r.json'
    write_results(path, street_evaluation.results)
    tree = json.loads(path.read_text())
    assert tree.pop('alignments') == {}
    path.write_text(json.dumps(tree))
    assert repr(read_results(path)) == repr(street_evaluation.results)


def test_results_of_an_older_format_are_refused(tmp_path: Path) -> None:
    path = tmp_path / 'r.json'
    path.write_text('{"format": "offradar-evaluation-2", "protocol": {}}')
    with pytest.raises(DataError, match=rf'expected format {FORMAT.tag}, got .*-2: run offradar evaluate again'):
        read_results(path)


@pytest.mark.parametrize(
    ('keys', 'value', 'message'),
    [
        (['groups', 'all', '5', 'ours', 'pairs'], 'six', 'six'),
        (['groups', 'all', '5', 'ours', 'ece'], True, 'True'),
        (['machine', 'core'], 2, 'core'),
        (['protocol', 'tolerance_m'], -1.0, 'tolerance_m'),
    ],
)
def test_damaged_results_are_named(
    keys: list[str], value: object, message: str, street_evaluation: StreetEvaluation, tmp_path: Path
) -> None:
    path = tmp_path / 'r.json'
    write_results(path, street_evaluation.results)
    tree = json.loads(path.read_text())
    branch = tree
    for key in keys[:-1]:
        branch = branch[key]
    branch[keys[-1]] = value
    path.write_text(json.dumps(tree))
    with pytest.raises(DataError) as refused:
        read_results(path)
    text = str(refused.value)
    assert text.startswith(f'{path}: damaged')
    assert message in text
    assert '\n' not in text


def test_scan_rows_refer_to_their_searches(street_evaluation: StreetEvaluation, tmp_path: Path) -> None:
    several = street_evaluation.measured
    rows, searches, kinds = scan_rows(several, street_evaluation.worlds)
    assert rows.dtype == SCANS
    expected = several[-1].ablations['streets', 15.0][-1].maintained
    last = rows[rows['pair'] == len(searches) - 1]
    assert (searches[-1].pair, searches[-1].maintained) == (expected.pair, True)
    assert [kinds[k] for k in last['kind']] == expected.kinds.tolist()
    np.testing.assert_array_equal(last['rank'], expected.ranks)
    first = rows[rows['pair'] == 0]
    assert (searches[0].pair, searches[0].maintained) == (several[0].answers[0].pair, False)
    np.testing.assert_array_equal(first['distance'], several[0].answers[0].distances.astype(np.float32))
    np.testing.assert_array_equal(first['x_m'], 4.0 * np.arange(60))
    assert set(first['y_m']) == {1.0}
    maps = map_arrays(several)
    write_arrays(tmp_path, rows, maps.arrays)
    found, arrays = read_arrays(tmp_path)
    assert found.tobytes() == rows.tobytes()
    assert set(arrays) == {f'{when}_{k}' for when in ('before', 'after') for k in range(len(maps.maps))}
    assert [dataclasses.astuple(kept.pair)[0] for kept in maps.maps] == ['ours', 'ours', 'stun', 'stun']
