"""Folder order is import order.

Each folder of the package, and each module beside the folders, imports only from those above it in `ORDER`. So the
vehicle's part stands without the laboratory (`lab`), which may import everything and is imported by nothing: the
command line reaches its commands by name. The core, up to `calibration`, stands without ROS.

Only imports at a module's level count. Those inside functions load something heavy where it is needed and are listed,
each of them, in `LAZY`. What `import` statements cannot tell, a fresh interpreter does: nothing of the core or the
command line loads rclpy, a runtime of learned encoders or a plotting library.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = 'offradar_ros'
PROJECT = Path(__file__).resolve().parent.parent

ORDER = (
    'errors',
    'types',
    'geometry',
    'sequence',
    'records',
    'config',
    'shipped',
    'processes',
    'radar',
    'messages',
    'encoders',
    'mapping',
    'retrieval',
    'stages',
    'recordings',
    'calibration',
    'ros',
    'nodes',
    'cli',
    'lab',
)
WITH_ROS = ('ros', 'nodes', 'lab.demo', 'lab.live')
WITH_TORCH = ('encoders.networks', 'encoders.export', 'calibration.shipping', 'lab.training')
LAZY = {
    ('cli.export', 'calibration.shipping'),
    ('cli.export', 'encoders.weights'),
    ('cli.session', 'ros.session_client'),
    ('encoders.export.onnx_export', 'encoders.export.onnx_half'),
    ('encoders.export.onnx_export', 'encoders.export.onnx_int8'),
    ('encoders.export.onnx_export', 'encoders.export.onnx_opencv'),
    ('encoders.export.onnx_export', 'encoders.networks.files'),
    ('encoders.export.onnx_export', 'encoders.networks.low_rank'),
    ('lab.cli.card', 'encoders.weights'),
    ('lab.cli.demo', 'lab.demo.run'),
    ('lab.cli.train', 'lab.training.config_file'),
    ('lab.cli.train', 'lab.training.recorded_drives'),
    ('lab.cli.train', 'lab.training.run'),
    ('recordings.source', 'recordings.bags.sequence'),
}
BACKENDS = {'encoders.onnx_backend', 'encoders.torch_backend'}
"""The modules that import a runtime of learned encoders when they are imported."""
HEAVY = ('rclpy', 'torch', 'onnxruntime', 'onnx', 'matplotlib', 'scipy')
VEHICLE = ('nodes.encoder_node', 'nodes.map_server_node', 'nodes.query_node')
"""What runs on the vehicle."""
OFF_THE_VEHICLE = ('recordings', 'calibration', 'cli', 'lab')
VAGUE = {'util', 'utils', 'common', 'helper', 'helpers', 'manager', 'managers', 'misc'}


class Import(NamedTuple):
    """One import of a module of the package by another, both without the package's name."""

    module: str
    imported: str
    lazy: bool


def module_name(file: Path, root: Path) -> str:
    parts = file.relative_to(root).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def unit(module: str) -> str:
    return module.partition('.')[0]


def imports_of(root: Path) -> list[Import]:
    """Every import of the package by itself; `from offradar_ros.a import b` is of a.b where that is a module.

    Those of the package root are left out: it loads an export when it is asked for it (test_exports.py).
    """
    files = {module_name(file, root): file for file in sorted(root.rglob('*.py'))}
    found = []
    for module, file in files.items():
        if not module:
            continue
        for node, lazy in walk(ast.parse(file.read_text(encoding='utf-8')), lazy=False):
            for name in imported_names(node):
                package, _, inner = name.partition('.')
                if package == PACKAGE:
                    of_root = inner not in files and '.' not in inner and inner != '__version__'
                    assert not of_root, f'{module}: {inner} of the package root hides the order'
                    imported = inner if inner in files else inner.rpartition('.')[0]
                    found.append(Import(module, imported, lazy))
    return found


def walk(node: ast.AST, lazy: bool) -> Iterator[tuple[ast.AST, bool]]:
    """Every node, and whether it is inside a function."""
    for child in ast.iter_child_nodes(node):
        yield child, lazy
        yield from walk(child, lazy or isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)))


def imported_names(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        assert not node.level, f'line {node.lineno}: relative imports hide the order'
        return [f'{node.module}.{alias.name}' for alias in node.names]
    return []


def violations(root: Path) -> list[str]:
    """What is against the order, one line each."""
    rank = {name: place for place, name in enumerate(ORDER)}
    found = imports_of(root)
    wrong = [
        f'{module} imports {imported}'
        for module, imported, lazy in found
        if not lazy and imported and unit(module) != unit(imported)
        if rank[unit(imported)] > rank[unit(module)]
    ]
    wrong += [
        f'{module} imports {imported} inside a function'
        for module, imported, lazy in found
        if lazy and imported and (module, imported) not in LAZY
    ]
    return sorted(wrong)


def reached(root: Path, starts: Iterable[str]) -> set[str]:
    """The modules that some import, directly or not, inside functions too, and the packages that hold them."""
    imports: dict[str, set[str]] = {}
    for each in imports_of(root):
        imports.setdefault(each.module, set()).add(each.imported)
    found, waiting = set[str](), list(starts)
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += [*imports.get(module, ()), module.rpartition('.')[0]]
    return found


def loaded_by(modules: list[str], path: Path) -> list[str]:
    """Which of `HEAVY` a fresh interpreter has loaded after importing `modules`, with `path` before all others."""
    code = f'import sys; sys.path.insert(0, {str(path)!r}); import {", ".join(modules)}; print(*sys.modules)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [name for name in HEAVY if name in done.stdout.split()]


def light_modules(root: Path) -> list[str]:
    names = [module_name(file, root) for file in sorted(root.rglob('*.py'))]
    apart = tuple(f'{name}.' for name in (*WITH_ROS, *WITH_TORCH))
    return [f'{PACKAGE}.{n}' for n in names if n and not f'{n}.'.startswith(apart) and n not in BACKENDS]


def vague_names(*folders: Path) -> list[str]:
    return [str(file) for folder in folders for file in folder.rglob('*.py') if VAGUE & {file.stem, file.parent.name}]


def test_each_folder_has_its_place() -> None:
    root = PROJECT / PACKAGE
    units = {unit(module_name(file, root)) for file in root.rglob('*.py')} - {''}
    assert units == set(ORDER)


def test_imports_go_upwards_only() -> None:
    assert violations(PROJECT / PACKAGE) == []


def test_every_listed_exception_is_needed() -> None:
    lazy = {(module, imported) for module, imported, inside in imports_of(PROJECT / PACKAGE) if inside}
    assert lazy == LAZY


def test_core_and_command_line_load_nothing_heavy() -> None:
    modules = light_modules(PROJECT / PACKAGE)
    assert f'{PACKAGE}.stages.map' in modules
    assert f'{PACKAGE}.cli.main' in modules
    assert f'{PACKAGE}.lab.cli.evaluate' in modules
    assert loaded_by(modules, PROJECT) == []


def test_the_vehicle_needs_only_the_onnx_runtime() -> None:
    pytest.importorskip('onnxruntime')
    assert loaded_by([f'{PACKAGE}.encoders.onnx_backend'], PROJECT) == ['onnxruntime']


def test_the_vehicle_reaches_nothing_of_recordings_commands_and_laboratory() -> None:
    modules = reached(PROJECT / PACKAGE, VEHICLE)
    assert 'stages.query' in modules
    assert sorted(module for module in modules if unit(module) in OFF_THE_VEHICLE) == []


def test_files_are_named_after_what_they_hold() -> None:
    assert vague_names(PROJECT / PACKAGE, PROJECT / 'test', PROJECT / 'benchmarks') == []


# That the tests above can fail: the same judges over packages made to be wrong.


def package(folder: Path, **sources: str) -> Path:
    root = folder / PACKAGE
    files = {'errors': '', 'cli__map': '', 'ros__qos': '', 'lab__demo__run': ''} | sources
    for name, source in files.items():
        file = root.joinpath(*name.split('__')).with_suffix('.py')
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(source)
    (root / '__init__.py').write_text('')
    return root


@pytest.mark.parametrize(
    ('sources', 'said'),
    [
        ({'radar__png': 'import offradar_ros.messages', 'messages': ''}, 'radar.png imports messages'),
        ({'errors': 'from offradar_ros.cli.map import show'}, 'errors imports cli.map'),
        ({'ros__run': 'from offradar_ros.cli import map'}, 'ros.run imports cli.map'),
        ({'ros__run': 'if True:\n    from offradar_ros.cli import map'}, 'ros.run imports cli.map'),
        ({'cli__main': 'class A:\n    import offradar_ros.lab.demo.run'}, 'cli.main imports lab.demo.run'),
        ({'nodes__query': 'import offradar_ros.cli.map'}, 'nodes.query imports cli.map'),
        (
            {'cli__main': 'def f():\n    if 1:\n        from offradar_ros.lab.demo.run import x'},
            'cli.main imports lab.demo.run inside a function',
        ),
    ],
)
def test_an_import_against_the_order_is_found(tmp_path: Path, sources: dict[str, str], said: str) -> None:
    assert violations(package(tmp_path, **sources)) == [said]


def test_imports_with_the_order_are_none(tmp_path: Path) -> None:
    sources = {
        'messages': 'from offradar_ros import __version__\nimport numpy, offradar_ros.errors',
        'nodes__query': 'from offradar_ros.ros import qos\nfrom offradar_ros.ros.qos import SCANS',
        'lab__cli__demo': 'from offradar_ros.cli import map',
    }
    assert violations(package(tmp_path, **sources)) == []


def test_a_relative_import_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match='relative imports'):
        violations(package(tmp_path, radar__png='from . import image'))


def test_an_import_of_an_export_is_found(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r'radar\.png: Config of the package root'):
        violations(package(tmp_path, radar__png='from offradar_ros import Config'))


def test_a_heavy_import_is_found(tmp_path: Path) -> None:
    (tmp_path / 'rclpy.py').write_text('')
    root = package(tmp_path, messages='import offradar_ros.stages', stages='import rclpy', nodes__query='import rclpy')
    assert light_modules(root) == [f'{PACKAGE}.{name}' for name in ('cli.map', 'errors', 'messages', 'stages')]
    assert loaded_by([f'{PACKAGE}.messages'], tmp_path) == ['rclpy']
    assert loaded_by([f'{PACKAGE}.errors'], tmp_path) == []


def test_what_is_reached_by_way_of_others_is_found(tmp_path: Path) -> None:
    sources = {
        'nodes__query': 'from offradar_ros.ros.qos import SCANS',
        'ros__qos': 'def f():\n    import offradar_ros.recordings.bags.reader',
        'recordings__bags__reader': '',
        'lab__demo__run': 'import offradar_ros.nodes.query',
    }
    root = package(tmp_path, **sources)
    (root / 'recordings' / '__init__.py').write_text('import offradar_ros.errors')
    found = reached(root, ['nodes.query'])
    assert {'nodes.query', 'ros.qos', 'recordings.bags.reader'} <= found
    assert 'errors' in found
    assert 'lab.demo.run' not in found


def test_a_vague_name_is_found(tmp_path: Path) -> None:
    root = package(tmp_path, radar__utils='', helpers__png='')
    assert sorted(vague_names(root)) == [str(root / 'helpers' / 'png.py'), str(root / 'radar' / 'utils.py')]
