"""`offradar`: the command line.

The module of a command is imported when the command is called, so that it needs only its own packages: training runs
without rosbags.
"""

import functools
import importlib
import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from offradar_ros import __version__
from offradar_ros.cli.outputs import require_other_outputs
from offradar_ros.entry_point import require_ordinary_files, run_guarded

COMMANDS = {
    'check': 'cli.check:check',
    'convert': 'cli.convert:convert',
    'simulate': 'lab.cli.simulate:simulate',
    'calibrate': 'cli.calibrate:calibrate',
    'drive': 'cli.drive:drive',
    'encode': 'lab.cli.encode:encode',
    'evaluate': 'lab.cli.evaluate:evaluate',
    'confidence': 'lab.cli.confidence:confidence',
    'report': 'lab.cli.report:report',
    'card': 'lab.cli.card:card',
    'map': 'cli.map:show_map',
    'session': 'cli.session:session',
    'export': 'cli.export:export',
    'parameters': 'cli.parameters:parameters',
    'demo': 'lab.cli.demo:demo',
    'train': 'lab.cli.train:train',
}
"""Each command's module in this package, and its function there."""


class _Commands(TyperGroup):
    """Lists the commands by name, and imports a command when it is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        del ctx
        if cmd_name not in COMMANDS:
            return None
        module, _, function = COMMANDS[cmd_name].partition(':')
        alone = typer.Typer(add_completion=False)
        alone.command(cmd_name)(_of_files(getattr(importlib.import_module(f'offradar_ros.{module}'), function)))
        return typer.main.get_command(alone)


def _of_files(command: Callable[..., Any]) -> Callable[..., Any]:
    """The command, which refuses a path that is a FIFO or a device, or holds one: it would wait for it for ever.

    It refuses to replace a file that it reads, too.
    """
    inputs = set()
    for name, parameter in inspect.signature(command).parameters.items():
        for option in getattr(parameter.annotation, '__metadata__', ()):
            # To Typer, a path that cannot be read is wrong usage; to the command, a file that cannot be read.
            option.readable = False
            if isinstance(option, typer.models.ArgumentInfo):
                inputs.add(name)

    @functools.wraps(command)
    def checked(**options: Any) -> Any:
        for name, value in options.items():
            for path in value if isinstance(value, (list, tuple)) else [value]:
                # The folder of an option may be any, such as the one that results are written to.
                if isinstance(path, Path) and (name in inputs or not path.is_dir()):
                    require_ordinary_files(path)
        require_other_outputs(command.__name__, options)
        return command(**options)

    return checked


app = typer.Typer(
    cls=_Commands,
    help='Radar place recognition that knows when it does not know.',
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f'offradar_ros {__version__}')
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option('--version', callback=_print_version, is_eager=True, help='Print the version and stop.')
    ] = False,
) -> None:
    del version


def main() -> int:
    """Entry point; wrong input gives one line and exit status 1."""
    # Read by NumPy when it is imported. Commands work in parallel threads or processes, one for each core; further
    # threads within those would wait for each other many times longer than they compute.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    return run_guarded(lambda: app(prog_name='offradar') or 0)


if __name__ == '__main__':
    sys.exit(main())
