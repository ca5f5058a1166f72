"""`offradar`: everything that is not a node."""

import sys
from typing import Annotated

import typer

from offradar_ros import __version__
from offradar_ros.cli.calibrate import calibrate
from offradar_ros.cli.check import check
from offradar_ros.cli.convert import convert
from offradar_ros.cli.demo import demo
from offradar_ros.cli.drive import drive
from offradar_ros.cli.export import export
from offradar_ros.cli.map import show_map
from offradar_ros.cli.parameters import parameters
from offradar_ros.cli.session import session
from offradar_ros.cli.simulate import simulate
from offradar_ros.errors import OffradarError

app = typer.Typer(
    help='Radar place recognition that knows when it does not know.',
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command()(check)
app.command()(convert)
app.command()(simulate)
app.command()(calibrate)
app.command()(drive)
app.command('map')(show_map)
app.command()(session)
app.command()(export)
app.command()(parameters)
app.command()(demo)


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
    """Entry point; what is wrong with the input is one line and exit status 1."""
    try:
        app(prog_name='offradar')
    except OffradarError as error:
        typer.echo(f'error: {error}', err=True)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
