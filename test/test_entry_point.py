"""Whatever a program meets at its edges is one line and an exit status, and never a wait without end."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import pytest
from unprivileged import obey_permissions

from offradar_ros.entry_point import REMEDIES, explain, require_ordinary_files, run_guarded, special_file
from offradar_ros.errors import DataError, RefusedInput

PROJECT = Path(__file__).resolve().parent.parent
OFFRADAR = [sys.executable, '-m', 'offradar_ros.cli.main']
WAIT_S = 120.0
SESSION = PROJECT / 'bags' / 'session_1'


def ended(
    *arguments: str | Path, env: dict[str, str] | None = None, stdout: int | IO[str] = subprocess.PIPE
) -> subprocess.CompletedProcess[str]:
    """A command that ran to its end, as a user to whom permissions apply."""
    return subprocess.run(
        [*OFFRADAR, *map(str, arguments)],
        env={**os.environ, 'PYTHONPATH': str(PROJECT), **(env or {})},
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        timeout=WAIT_S,
        check=False,
        preexec_fn=obey_permissions,
    )


def assert_refused(ran: subprocess.CompletedProcess[str], *expected: str) -> None:
    assert ran.returncode == 1, ran.stderr
    (line,) = [each for each in ran.stderr.splitlines() if '━' not in each]
    assert line.startswith('error: ')
    for text in expected:
        assert text in line


@pytest.mark.parametrize('number', REMEDIES)
def test_an_error_of_the_operating_system_says_where_and_what_to_do(number: int) -> None:
    text = explain(OSError(number, os.strerror(number), '/data/town.db'))
    assert text.startswith('/data/town.db: ')
    assert text.endswith(REMEDIES[number])


@pytest.mark.parametrize(
    ('error', 'expected'),
    [
        (DataError('bag: empty'), 'bag: empty'),
        (RefusedInput('late', 'scan 1: late'), 'scan 1: late'),
        (MemoryError(), 'out of memory'),
        (ModuleNotFoundError("No module named 'mcap'", name='mcap.reader'), 'the package mcap cannot be used'),
        (FileNotFoundError(errno.ENOENT, 'No such file or directory', b'/x\xff'), '/x'),
        (TimeoutError(), 'TimeoutError'),
    ],
)
def test_known_errors_are_explained(error: Exception, expected: str) -> None:
    assert expected in explain(error)
    assert len(explain(error).splitlines()) == 1


@pytest.mark.parametrize(
    'error', [KeyError('x'), ValueError('x'), ModuleNotFoundError(name='offradar_ros.nothing'), ImportError()]
)
def test_a_defect_is_not_explained_away(error: Exception) -> None:
    assert explain(error) == ''


def test_a_defect_shows_its_traceback_and_ends_with_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    def program() -> int:
        raise ZeroDivisionError

    assert run_guarded(program) == 1
    printed = capsys.readouterr().err.strip().splitlines()
    assert printed[0].startswith('Traceback')
    assert printed[-1].startswith('error: a defect in offradar_ros')


@pytest.mark.parametrize(
    ('error', 'status', 'said'),
    [
        (KeyboardInterrupt(), 130, 'interrupted\n'),
        (MemoryError(), 1, 'error: out of memory: close other programs, or use a smaller input\n'),
        (BrokenPipeError(), 1, ''),
    ],
)
def test_the_exit_status_of_a_program_that_is_cut_off(
    capsys: pytest.CaptureFixture[str], error: BaseException, status: int, said: str
) -> None:
    def program() -> int:
        raise error

    assert run_guarded(program) == status
    assert capsys.readouterr().err == said


def guarded(
    body: str, redirection: str = '', environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[bytes]:
    """A process that does no more than `body` within the guard, with its output redirected by a shell."""
    program = f'import sys; from offradar_ros.entry_point import run_guarded; sys.exit(run_guarded(lambda: {body}))'
    return subprocess.run(
        ['sh', '-c', f'exec "$0" -c "$1" {redirection}', sys.executable, program],
        env={**os.environ, 'PYTHONPATH': str(PROJECT), **(environment or {})},
        capture_output=True,
        timeout=WAIT_S,
        check=False,
    )


def test_output_that_cannot_be_written_is_an_error() -> None:
    ran = guarded("print('x') or 0", '>/dev/full')
    assert ran.returncode == 1
    assert ran.stderr == b'error: No space left on device: free some space, or write elsewhere\n'


def test_a_reader_that_stops_reading_is_no_error() -> None:
    for body in ("print('x') or 0", "[print('x' * 100) for _ in range(10_000)] and 0"):
        program = f'from offradar_ros.entry_point import run_guarded; raise SystemExit(run_guarded(lambda: {body}))'
        process = subprocess.Popen(
            [sys.executable, '-c', program], cwd=PROJECT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        assert process.stdout is not None
        process.stdout.close()
        _, said = process.communicate(timeout=WAIT_S)
        assert (process.returncode, said) == (1, b'')


def test_a_program_without_stdout_and_stderr_ends_as_usual() -> None:
    assert guarded("print('x') or 0", '>&- 2>&-').returncode == 0
    ran = guarded("open('/no/such/file') and 0", '2>&-')
    assert (ran.returncode, ran.stdout) == (1, b'')


@pytest.mark.parametrize('encoding', ['ascii', 'latin-1', 'utf-8'])
def test_what_an_encoding_does_not_have_is_printed_as_an_escape(encoding: str) -> None:
    ran = guarded(r"print('\u03b1 \udcff') or 0", environment={'PYTHONIOENCODING': encoding})
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.endswith(b' \\udcff\n')


@pytest.fixture
def locked(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / 'locked'
    folder.mkdir()
    folder.chmod(0)
    yield folder
    folder.chmod(0o700)


@pytest.mark.parametrize(
    'arguments',
    [
        ('check', '{}'),
        ('check', '{}/drive'),
        ('check', SESSION, '--params', '{}/car.yaml'),
        ('convert', '{}/drive', '{tmp}/out'),
        ('convert', SESSION, '{}/out'),
        ('calibrate', '{}/drive', '--out', '{tmp}/car.yaml'),
        ('calibrate', SESSION, '--out', '{}/car.yaml'),
        ('drive', '{}/drive'),
        ('drive', SESSION, '--map', '{}/town.db'),
        ('drive', SESSION, '--map', '{}/town.db', '--session', 'a'),
        ('drive', SESSION, '--out', '{}/answers.csv'),
        ('map', '{}/town.db'),
        ('export', '{}/a.safetensors', '{tmp}/a.onnx'),
        ('parameters', '--out', '{}/car.yaml'),
        ('report', '{}/results'),
        ('train', '--config', '{}/train.yaml', '--out', '{tmp}/out'),
        ('evaluate', '{}/protocol.yaml', '--method', 'ring_key', '--out', '{tmp}/out'),
    ],
)
def test_a_folder_that_may_not_be_entered_is_one_line(
    locked: Path, tmp_path: Path, arguments: tuple[object, ...]
) -> None:
    ran = ended(*(str(each).format(locked, tmp=tmp_path) for each in arguments))
    assert_refused(ran, str(locked), 'ermission denied')


def test_a_working_folder_that_was_removed_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = FileNotFoundError(errno.ENOENT, 'No such file or directory', 'out')
    assert explain(missing) == 'out: No such file or directory'

    def refuse() -> str:
        raise missing

    monkeypatch.setattr(os, 'getcwd', refuse)
    assert explain(missing) == 'the working folder was removed: change to another'


def test_a_special_file_is_recognised(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'pipe')
    assert special_file(tmp_path / 'pipe') == 'a FIFO'
    assert special_file('/dev/null') == 'a device'
    assert (
        special_file(tmp_path)
        == special_file(__file__)
        == special_file(tmp_path / 'nothing')
        == special_file('a\0b')
        == ''
    )


@pytest.mark.parametrize(
    'arguments',
    [
        ('check', '{}'),
        ('check', SESSION, '--params', '{}'),
        ('convert', '{}', 'out'),
        ('calibrate', SESSION, '--params', '{}', '--out', 'car.yaml'),
        ('calibrate', SESSION, '{}', '--out', 'car.yaml'),
        ('drive', '{}'),
        ('drive', SESSION, '--map', '{}'),
        ('map', '{}'),
        ('export', '{}', 'a.onnx'),
        ('parameters', '--out', '{}'),
        ('train', '--config', '{}', '--out', 'out'),
        ('report', '{}'),
    ],
)
def test_a_fifo_is_refused_and_not_waited_for(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[object, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / 'pipe')
    printed = refused(*(str(each).format(tmp_path / 'pipe') for each in arguments))
    assert f'{tmp_path / "pipe"}: is a FIFO: expected a file or a folder' in printed


@pytest.mark.parametrize('command', [('check',), ('convert', 'out'), ('drive',), ('calibrate', '--out', 'car.yaml')])
@pytest.mark.parametrize('name', ['metadata.yaml', 'a.mcap', 'radar/1547131046353776.png', 'gps/gps.csv', 'link'])
def test_a_fifo_in_a_recording_is_refused_and_not_waited_for(
    refused: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: tuple[str, ...],
    name: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'drive' / name
    path.parent.mkdir(parents=True)
    os.mkfifo(tmp_path / 'pipe')
    path.symlink_to(tmp_path / 'pipe')
    assert f'{path}: is a FIFO' in refused(command[0], tmp_path / 'drive', *command[1:])
    path.unlink()
    os.mkfifo(path)
    assert f'{path}: is a FIFO' in refused(command[0], tmp_path / 'drive', *command[1:])


def test_a_folder_without_special_files_is_accepted(tmp_path: Path) -> None:
    (tmp_path / 'a').mkdir()
    (tmp_path / 'a' / 'loop').symlink_to(tmp_path)
    (tmp_path / 'a' / 'dangling').symlink_to(tmp_path / 'nothing')
    require_ordinary_files(tmp_path)


def test_a_working_folder_that_was_removed_is_one_line(tmp_path: Path) -> None:
    gone = tmp_path / 'gone'
    gone.mkdir()
    command = f'cd {gone} && rmdir {gone} && exec {sys.executable} -m offradar_ros.cli.main convert {SESSION} out'
    environment = {**os.environ, 'PYTHONPATH': str(PROJECT)}
    ran = subprocess.run(
        ['sh', '-c', command], env=environment, capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert_refused(ran)


@pytest.mark.parametrize(
    'encoding', [{}, {'PYTHONIOENCODING': 'ascii'}, {'LC_ALL': 'C', 'PYTHONUTF8': '0', 'PYTHONCOERCECLOCALE': '0'}]
)
def test_a_name_that_no_encoding_has_is_printed_all_the_same(tmp_path: Path, encoding: dict[str, str]) -> None:
    name = os.fsencode(tmp_path) + b'/\xff\xfe'
    assert_refused(ended('check', os.fsdecode(name), env=encoding), 'no such folder')
    assert ended('parameters', env=encoding).returncode == 0


def close_all(numbers: tuple[int, ...]) -> None:
    for number in numbers:
        os.close(number)


@pytest.mark.parametrize('closed', [(0,), (2,), (1, 2), (0, 1, 2)])
def test_a_program_without_its_streams_writes_nothing_into_its_files(tmp_path: Path, closed: tuple[int, ...]) -> None:
    """A file that took the number of stderr would hold what libraries print."""
    code = (
        'import os, sys\n'
        'from offradar_ros.entry_point import run_guarded\n'
        'def program():\n'
        '    file = os.open(sys.argv[1], os.O_CREAT | os.O_WRONLY)\n'
        '    assert file > 2\n'
        '    os.write(file, b"kept")\n'
        '    os.write(2, b"printed by a library")\n'
        '    print("printed"), sys.stdout.write("printed"), sys.stderr.write("printed")\n'
        '    return 0\n'
        'sys.exit(run_guarded(program))\n'
    )
    ran = subprocess.run(
        [sys.executable, '-c', code, tmp_path / 'file'],
        env={**os.environ, 'PYTHONPATH': str(PROJECT)},
        timeout=WAIT_S,
        check=False,
        preexec_fn=lambda: close_all(closed),
    )
    assert ran.returncode == 0
    assert (tmp_path / 'file').read_bytes() == b'kept'


def test_check_without_stderr_prints_its_findings() -> None:
    ran = subprocess.run(
        [*OFFRADAR, 'check', SESSION],
        env={**os.environ, 'PYTHONPATH': str(PROJECT)},
        stdout=subprocess.PIPE,
        text=True,
        timeout=WAIT_S,
        check=False,
        preexec_fn=lambda: os.close(2),
    )
    assert ran.returncode == 0
    assert '10 scans' in ran.stdout
