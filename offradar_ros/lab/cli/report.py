"""`offradar report`: an evaluation as HTML, Markdown and CSV tables."""

import importlib.util
from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.cli.install_hints import pip_hint
from offradar_ros.errors import ConfigError
from offradar_ros.lab.report.build import build_report
from offradar_ros.lab.report.source import read_source
from offradar_ros.lab.report.write import write_report


def report(
    folder: Annotated[Path, typer.Argument(help='Folder of results: --out of offradar evaluate.')],
    out: Annotated[Optional[Path], typer.Option(help='Folder for the report; FOLDER/report if not given.')] = None,
) -> None:
    """Write report.html (self-contained), report.md with figures/, and tables/ as CSV."""
    for package in ('matplotlib', 'jinja2'):
        if importlib.util.find_spec(package) is None:
            raise ConfigError(f'reports need the Python package {package}: {pip_hint("plot")}')
    made = build_report(read_source(folder))
    written = write_report(made, out or folder / 'report')
    typer.echo(f'{written[0]}: {len(made.tables)} tables, {len(made.figures)} figures')
    typer.echo(f'{written[1]}, and {len(written) - 2} files of tables and figures: written')
