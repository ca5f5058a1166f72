"""`offradar map`: the contents of a map file, or a copy of it."""

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from offradar_ros.errors import ConfigError
from offradar_ros.mapping.map_reader import log_of
from offradar_ros.mapping.store import MapStore
from offradar_ros.mapping.stored_map import StoredMap
from offradar_ros.mapping.whole_map import back_up
from offradar_ros.mapping.writer_lock import has_writer
from offradar_ros.types import ScanKey

REPORTED = {
    'inserted': 'inserted',
    'replaced': 'replaced',
    'kept': 'kept',
    'dropped': 'dropped',
    'places': 'places_after',
    'U\nbefore': 'mean_uncertainty_before',
    'U\nafter': 'mean_uncertainty_after',
}


def show_map(
    path: Annotated[Path, typer.Argument(help='SQLite map file.')],
    backup: Annotated[
        Optional[Path], typer.Option(help='Copy the map to this file, also while a map server writes it.')
    ] = None,
    overwrite: Annotated[bool, typer.Option('--overwrite', help='Replace the file of --backup.')] = False,
) -> None:
    """Print the model, the origin and the sessions of a map, without changing it."""
    if backup is not None:
        back_up(path, backup, overwrite=overwrite)
        typer.echo(f'{backup}: the map as of the last save, written and read again')
        return
    if overwrite:
        raise ConfigError('--overwrite replaces the file of --backup: give --backup FILE')
    # Before the file is read: a session that a process starts after this is not in the file that is read.
    is_written = has_writer(path)
    stored = MapStore.open_read_only(path)
    model, origin = stored.model, stored.origin
    typer.echo(f'{path}: {len(stored.places)} places')
    if stored.is_log_foreign:
        typer.echo(
            f'note: {log_of(path).name} beside it belongs to another file, or another state of it: it was not read'
        )
    if model:
        typer.echo(f'model: {model.name}, d = {model.dimension}, {model.fingerprint}')
    if origin:
        typer.echo(f'origin: {origin.latitude_deg:.7f}°, {origin.longitude_deg:.7f}°, {origin.altitude_m:.2f} m')
    if len(stored.places):
        typer.echo(f'mean U: {stored.places.uncertainties.mean():.4f}')
        typer.echo(_signatures(stored))
    table = Table(
        Column('id', no_wrap=True),
        Column('session', overflow='fold'),
        Column('date (UTC)', no_wrap=True),
        Column('state', no_wrap=True),
        *(Column(name, no_wrap=True) for name in REPORTED),
        collapse_padding=True,
        pad_edge=False,
        padding=0,
    )
    # The next writer of the file marks a session that was cut off; until then its state in the file is running.
    states = [
        'interrupted' if session.state == 'running' and not is_written else session.state for session in stored.sessions
    ]
    for session, state in zip(stored.sessions, states, strict=True):
        figures = [_readable(session.report, column) for column in REPORTED.values()]
        table.add_row(str(session.session_id), escape(session.name), _day(session.stamp_ns), escape(state), *figures)
    Console().print(table)
    if 'interrupted' in states:
        typer.echo('interrupted: saved, then the process ended before the session did; it is kept and can be undone')


def _signatures(stored: StoredMap) -> str:
    """How many places have a signature, and the size of all, with those of scans that an undo restores."""
    places, held = stored.places, stored.signatures
    scans = map(ScanKey, places.session_ids.tolist(), places.stamps_ns.tolist())
    kilobytes = sum(map(len, held.values())) / 1000.0
    return f'signatures: {sum(scan in held for scan in scans)} of {len(places)} places, {kilobytes:.1f} kB with undo'


def _readable(report: Mapping[str, Any], column: str) -> str:
    value = report.get(column)
    if value is None:
        return ''
    if isinstance(value, Mapping):
        return str(sum(value.values()))
    return f'{value:.3f}' if isinstance(value, float) else str(value)


def _day(stamp_ns: int) -> str:
    try:
        return datetime.datetime.fromtimestamp(stamp_ns // 10**9, datetime.timezone.utc).strftime('%Y-%m-%d')
    except (ValueError, OverflowError, OSError):
        return ''
