"""Each form of record is attacked from a sound one."""

from __future__ import annotations

from pathlib import Path

import pytest
from faults.mutated_records import attack
from faults.record_form import Form
from faults.result import Settings

from offradar_ros.errors import DataError


def test_a_form_whose_sound_record_is_refused_is_an_error(tmp_path: Path) -> None:
    """Or else all its tries are refused for the same reason, and none says anything."""

    def refuse(_: bytes, __: Path) -> None:
        raise DataError('table.csv, line 1: expected a header')

    with pytest.raises(SystemExit, match=r'error: table: the sound record is not taken: .*expected a header'):
        attack(Settings(tmp_path), Form('table', b'1,2', refuse, 10), 0)


def test_tries_are_made_of_a_form_that_is_taken(tmp_path: Path) -> None:
    result = attack(Settings(tmp_path), Form('text', b'1,2', lambda _, __: None, 10), 0)
    assert (result.tries, result.same) == (10, 10)
