"""`offradar map`: what a map file holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from offradar_ros.mapping.store import MapStore

REPORTED = ('inserted', 'replaced', 'kept', 'places_after', 'mean_uncertainty_before', 'mean_uncertainty_after')


def show_map(path: Annotated[Path, typer.Argument(help='SQLite map file.')]) -> None:
    """Print the model, the origin and the sessions of a map, without changing it."""
    stored = MapStore.open_read_only(path)
    model, origin = stored.model, stored.origin
    console = Console()
    console.print(f'{path}: {len(stored.places)} places', highlight=False)
    if model:
        console.print(f'model: {model.name}, d = {model.dimension}, {model.fingerprint}', highlight=False)
    if origin:
        console.print(
            f'origin: {origin.latitude_deg:.7f}°, {origin.longitude_deg:.7f}°, {origin.altitude_m:.2f} m',
            highlight=False,
        )
    if len(stored.places):
        console.print(f'mean U: {stored.places.uncertainties.mean():.4f}', highlight=False)
    table = Table('session', 'name', 'state', 'inserted', 'replaced', 'kept', 'places', 'mean U before', 'after')
    for session in stored.sessions:
        told = [session.report.get(column) for column in REPORTED]
        cells = ['' if v is None else f'{v:.4f}' if isinstance(v, float) else str(v) for v in told]
        table.add_row(str(session.session_id), session.name, session.state, *cells)
    console.print(table)
