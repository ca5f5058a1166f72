"""`offradar map`: what a map file holds."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from offradar_ros.mapping.store import MapStore

REPORTED = {
    'inserted': 'inserted',
    'replaced': 'replaced',
    'kept': 'kept',
    'places': 'places_after',
    'U before': 'mean_uncertainty_before',
    'U after': 'mean_uncertainty_after',
}


def show_map(path: Annotated[Path, typer.Argument(help='SQLite map file.')]) -> None:
    """Print the model, the origin and the sessions of a map, without changing it."""
    stored = MapStore.open_read_only(path)
    model, origin = stored.model, stored.origin
    typer.echo(f'{path}: {len(stored.places)} places')
    if model:
        typer.echo(f'model: {model.name}, d = {model.dimension}, {model.fingerprint}')
    if origin:
        typer.echo(f'origin: {origin.latitude_deg:.7f}°, {origin.longitude_deg:.7f}°, {origin.altitude_m:.2f} m')
    if len(stored.places):
        typer.echo(f'mean U: {stored.places.uncertainties.mean():.4f}')
    table = Table(
        '',
        Column('session', overflow='fold'),
        'state',
        *(Column(name, no_wrap=True) for name in REPORTED),
        collapse_padding=True,
    )
    for session in stored.sessions:
        told = [session.report.get(column) for column in REPORTED.values()]
        cells = ['' if v is None else f'{v:.3f}' if isinstance(v, float) else str(v) for v in told]
        table.add_row(str(session.session_id), escape(session.name), session.state, *cells)
    Console().print(table)
