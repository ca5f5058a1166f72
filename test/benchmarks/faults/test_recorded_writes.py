"""What a power cut may leave, and what it must leave."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from faults.recorded_writes import SECTOR, Change, after_a_cut, record

FOLDER = '/maps'


def change(operation: str, file: int, name: str, data: bytes = b'', offset: int = 0, length: int = 0) -> Change:
    names = (f'{FOLDER}/old', name) if operation == 'R' else (name,)
    return Change(operation, file, offset, length or len(data), names, data)


OLD, NEW = b'o' * 2 * SECTOR, b'n' * 2 * SECTOR
CREATED = [change('C', 0, f'{FOLDER}/a'), change('S', -1, FOLDER)]


def outcomes(changes: list[Change]) -> set[bytes | None]:
    return {after_a_cut(changes, np.random.default_rng(seed)).get(f'{FOLDER}/a') for seed in range(400)}


def test_what_was_synchronised_stays() -> None:
    written = [*CREATED, change('W', 0, f'{FOLDER}/a', OLD), change('S', 0, f'{FOLDER}/a')]
    assert outcomes(written) == {OLD}


def test_what_was_not_is_there_by_any_part() -> None:
    synced = [*CREATED, change('W', 0, f'{FOLDER}/a', OLD), change('S', 0, f'{FOLDER}/a')]
    found = outcomes([*synced, change('W', 0, f'{FOLDER}/a', NEW)])
    halves = {OLD[:SECTOR], NEW[:SECTOR]}
    assert found == {first + second for first in halves for second in halves}


def test_a_name_may_be_missing_until_its_folder_was_synchronised() -> None:
    created = [change('C', 0, f'{FOLDER}/a'), change('W', 0, f'{FOLDER}/a', OLD), change('S', 0, f'{FOLDER}/a')]
    assert outcomes(created) == {None, OLD}
    assert outcomes([*created, change('S', -1, FOLDER)]) == {OLD}


def test_a_file_that_is_cut_and_written_again() -> None:
    written = [*CREATED, change('W', 0, f'{FOLDER}/a', OLD), change('S', 0, f'{FOLDER}/a')]
    assert outcomes([*written, change('T', 0, f'{FOLDER}/a', length=SECTOR)]) == {OLD, OLD[:SECTOR]}


def test_a_program_is_recorded_whole(tmp_path: Path) -> None:
    if subprocess.run(['cc', '--version'], capture_output=True, check=False).returncode:
        pytest.skip('no C compiler')
    under = tmp_path / 'under'
    under.mkdir()
    program = (
        'import os, shutil, sys; os.chdir(sys.argv[1]); open("a", "w").write("one"); os.replace("a", "b"); '
        'os.mkdir("c"); open("c/d", "w").write("two"); os.link("c/d", "e"); shutil.rmtree("c"); '
        'f = open("b", "r+"); f.seek(1); f.write("N"); f.close(); os.truncate("e", 2)'
    )
    # A relative name is not seen: this program is told of, instead of being simulated wrongly.
    with pytest.raises(SystemExit, match='calls that are not recorded'):
        record(['-c', program, str(under)], under, tmp_path, [])
