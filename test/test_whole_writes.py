"""Every file of the package is written whole or not at all: nothing writes to a file of a user but `whole_file`."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / 'offradar_ros'

METHODS = {'write_text', 'write_bytes', 'savefig', 'tofile', 'touch', 'open_memmap'}
"""Methods and functions that write to a path, whatever they belong to."""
FUNCTIONS = {
    **dict.fromkeys(('np.save', 'np.savez', 'np.savez_compressed', 'np.savetxt', 'np.memmap'), 'an array'),
    **dict.fromkeys(('cv2.imwrite', 'cv2.FileStorage', 'cv2.VideoWriter'), 'an image'),
    **dict.fromkeys(('torch.save', 'onnx.save', 'save_file', 'torch.onnx.export', 'onnx.save_model'), 'a model'),
    **dict.fromkeys(('shutil.copy', 'shutil.copy2', 'shutil.copyfile', 'shutil.copytree', 'shutil.move'), 'a copy'),
    **dict.fromkeys(('tempfile.NamedTemporaryFile', 'tempfile.mkstemp'), 'a file'),
}

ALLOWED = {
    ('calibration.picture_file', 'savefig'): 'into memory',
    ('lab.report.curves', 'savefig'): 'into memory',
    ('lab.array_file', 'np.save'): 'into memory',
    ('lab.evaluation.results.arrays', 'np.savez_compressed'): 'into memory',
    ('encoders.export.onnx_export', 'torch.onnx.export'): 'into a temporary folder',
    ('recordings.bags.bag_check', "open('wb')"): 'into a temporary folder',
    ('recordings.bags.mcap_checksums', "open('r+b')"): 'within a new folder, which appears when it is complete',
    ('recordings.datasets.oxford_writer', 'write_bytes'): 'within a new folder, which appears when it is complete',
    ('recordings.datasets.oxford_writer', 'write_text'): 'within a new folder, which appears when it is complete',
    ('recordings.datasets.oxford_writer', "open('w')"): 'within a new folder, which appears when it is complete',
    ('lab.training.run_log', "open('a')"): 'a log grows by a line; half a line at its end is not read',
    ('lab.training.run', "open('a')"): 'a log grows by a line',
    ('lab.live.node_processes', "open('wb')"): 'what a process prints',
    ('lab.demo.run', 'touch'): 'an empty file',
    ('entry_point', 'os.open'): 'takes the places of standard streams that are closed',
    ('mapping.held_file', 'os.open'): 'holds the map file, and writes nothing',
    ('mapping.writer_lock', 'os.open'): 'a lock, without content',
}
"""Calls that may write, by module and call, and why they may."""

MODULES = {'io', 'zstd', 'gzip', 'bz2', 'lzma', 'zipfile'}
"""Modules with a function ``open`` of their own."""


def dotted(node: ast.expr) -> str:
    """The name of what is called, as far as it is names."""
    if isinstance(node, ast.Attribute):
        return f'{dotted(node.value)}.{node.attr}'.lstrip('.')
    return node.id if isinstance(node, ast.Name) else ''


def writes(source: str) -> Iterator[str]:
    """The calls of a module that may write a file."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call):
            continue
        name = dotted(node.func)
        last = name.rpartition('.')[2]
        if last in METHODS:
            yield last
        elif name in FUNCTIONS:
            yield name
        elif name == 'os.open':
            flags = ast.unparse(node.args[1])
            if any(word in flags for word in ('O_WRONLY', 'O_RDWR', 'O_CREAT', 'O_TRUNC', 'O_APPEND')):
                yield name
        elif last == 'open':
            # Of a path the mode comes first, of the function and of modules second.
            is_function = isinstance(node.func, ast.Name) or name.rpartition('.')[0] in MODULES
            place = 1 if is_function else 0
            given = [k.value for k in node.keywords if k.arg == 'mode'] or node.args[place : place + 1]
            mode = ast.literal_eval(given[0]) if given and isinstance(given[0], ast.Constant) else None
            if isinstance(mode, str) and set(mode) & set('wax+'):
                yield f'open({mode!r})'
            elif given and isinstance(given[0], ast.Name) and 'mode' in given[0].id:
                yield 'open(mode)'


def modules() -> Iterator[tuple[str, Path]]:
    """Every module but the one that writes."""
    for path in sorted(set(PACKAGE.rglob('*.py')) - {PACKAGE / 'whole_file.py'}):
        yield '.'.join(path.relative_to(PACKAGE).with_suffix('').parts), path


def test_files_are_written_by_whole_file_alone() -> None:
    found = {(module, call) for module, path in modules() for call in writes(path.read_text(encoding='utf-8'))}
    assert found - ALLOWED.keys() == set(), 'write it with offradar_ros.whole_file, or say here why not'
    assert ALLOWED.keys() - found == set(), 'no longer there'


@pytest.mark.parametrize(
    'source',
    [
        "Path('x').write_text('')",
        "open(path, 'w')",
        "path.open('ab')",
        'path.open(mode=mode)',
        'figure.savefig(path)',
        "np.save('x', array)",
        'os.open(path, os.O_WRONLY | os.O_CREAT)',
        'cv2.imwrite(path, image)',
        'torch.save(network, path)',
    ],
)
def test_a_write_is_found(source: str) -> None:
    assert list(writes(source))


@pytest.mark.parametrize(
    'source', ['open(path)', "path.open('rb')", 'path.open(encoding=x)', 'os.open(path, os.O_RDONLY)']
)
def test_a_read_is_none(source: str) -> None:
    assert not list(writes(source))
