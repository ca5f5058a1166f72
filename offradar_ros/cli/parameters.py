"""`offradar parameters`: every parameter of the nodes, as a table or as a parameter file."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.config import Bounds, Config, Parameter, write_parameters
from offradar_ros.config import parameters as leaves


def parameters(
    out: Annotated[Optional[Path], typer.Option(help='Write a parameter file with every default instead.')] = None,
) -> None:
    """Print every parameter with its default, bounds and meaning, as a Markdown table."""
    if out is not None:
        write_parameters(out, {leaf.name: leaf.value for leaf in leaves(Config())}, 'Every parameter at its default.')
        typer.echo(f'{out}: written')
        return
    typer.echo(markdown_table())


def markdown_table() -> str:
    """The table in docs/nodes.md."""
    rows = ['| parameter | default | allowed | meaning |', '|---|---|---|---|']
    for leaf in leaves(Config()):
        rows.append(f'| `{leaf.name}` | {_value(leaf)} | {_allowed(leaf.bounds)} | {_meaning(leaf)} |')
    return '\n'.join(rows)


def _value(leaf: Parameter) -> str:
    value = str(leaf.value).lower() if isinstance(leaf.value, bool) else str(leaf.value)
    return f'`{value}`' if value else "`''`"


def _allowed(bounds: Bounds) -> str:
    if bounds.choices:
        return ', '.join(bounds.choices)
    ends = ['' if end is None else f'{end:g}' for end in (bounds.minimum, bounds.maximum)]
    span = ' … '.join(ends) if any(ends) else ''
    return f'{span} {bounds.unit}'.strip()


def _meaning(leaf: Parameter) -> str:
    return leaf.bounds.description + ('' if leaf.bounds.read_only else ' (may change at run time)')
