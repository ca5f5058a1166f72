"""Options that choose the topics of a bag, of every command that reads one."""

from typing import Annotated

import typer

Topic = Annotated[
    str,
    typer.Option(
        '--topic', metavar='NAME', help='Topic of the polar scans of a bag, where it holds several that may be.'
    ),
]
Positions = Annotated[
    str,
    typer.Option(
        '--positions', metavar='NAME', help='Topic of the positions of a bag, where it holds several that may be.'
    ),
]
