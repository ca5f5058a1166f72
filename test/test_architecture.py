"""The order of the folders is the order of imports.

Each folder of the package, and each module next to the folders, imports only from those above it in `ORDER`. So the
vehicle's part does not depend on the laboratory (`lab`), which may import everything and is imported by nothing: the
command line loads its commands by name. The core, up to `calibration`, does not depend on ROS.

The order applies to imports at module level. Imports inside functions load something heavy when it is needed; `LAZY`
lists each of them. A new interpreter checks what `import` statements do not show: no module of the core or the command
line loads rclpy, a runtime of learned encoders or a plotting library.
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
    'entry_point',
    'whole_file',
    'bounded_input',
    'yaml_digest',
    'types',
    'geometry',
    'positions',
    'sequence',
    'records',
    'config',
    'shipped',
    'processes',
    'radar',
    'messages',
    'alignment',
    'encoders',
    'mapping',
    'retrieval',
    'belief',
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
    ('cli.session', 'ros.initialise'),
    ('cli.session', 'ros.session_client'),
    ('cli.session', 'ros.shared_memory'),
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
"""Modules that import a runtime of learned encoders at module level."""
HEAVY = ('rclpy', 'torch', 'onnxruntime', 'onnx', 'matplotlib', 'scipy')
VEHICLE = ('nodes.encoder_node', 'nodes.map_server_node', 'nodes.query_node')
"""Modules that run on the vehicle."""
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
    """Imports between modules of the package; `from offradar_ros.a import b` imports a.b if that is a module.

    Imports of the package root are not included: it loads each export at its first use (test_exports.py).
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
                    assert not of_root, f'{module}: {inner} of the package root is not in the order'
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
        assert not node.level, f'line {node.lineno}: relative imports are not in the order'
        return [f'{node.module}.{alias.name}' for alias in node.names]
    return []


def violations(root: Path) -> list[str]:
    """Imports that violate the order, one line each."""
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
    """Modules that `starts` import, directly or not, also inside functions, and the packages that hold them."""
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
    """Names in `HEAVY` that a new interpreter has loaded after an import of `modules`, with `path` first."""
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


def test_each_folder_is_in_the_order() -> None:
    root = PROJECT / PACKAGE
    units = {unit(module_name(file, root)) for file in root.rglob('*.py')} - {''}
    assert units == set(ORDER)


def test_imports_go_upwards_only() -> None:
    assert violations(PROJECT / PACKAGE) == []


def test_every_listed_import_inside_a_function_exists() -> None:
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


def test_the_vehicle_imports_no_recordings_commands_or_laboratory() -> None:
    modules = reached(PROJECT / PACKAGE, VEHICLE)
    assert 'stages.query' in modules
    assert sorted(module for module in modules if unit(module) in OFF_THE_VEHICLE) == []


def test_files_are_named_after_what_they_hold() -> None:
    assert vague_names(PROJECT / PACKAGE, PROJECT / 'test', PROJECT / 'benchmarks') == []


# The tests above can fail: the same checks of packages with violations.


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
    ('sources', 'violation'),
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
def test_an_import_against_the_order_is_found(tmp_path: Path, sources: dict[str, str], violation: str) -> None:
    assert violations(package(tmp_path, **sources)) == [violation]


def test_imports_in_the_order_are_accepted(tmp_path: Path) -> None:
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


def test_indirect_imports_are_found(tmp_path: Path) -> None:
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
