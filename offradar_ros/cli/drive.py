"""`offradar drive`: a bag through the whole pipeline without ROS, at full CPU speed."""

import contextlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Optional

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from offradar_ros.cli.answers import recall_line, write_answers
from offradar_ros.cli.bag_topics import Positions, Topic
from offradar_ros.cli.interrupt import held_interrupt
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import Config, load_config
from offradar_ros.encoders.protocol import Encoder, ModelInfo
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import DataError, MapError
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.map_reader import status_of
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.signature_file import SignatureFile
from offradar_ros.mapping.store import MapStore
from offradar_ros.recordings.bags.position_topic import position_topic
from offradar_ros.recordings.bags.positions import read_positions
from offradar_ros.recordings.bags.reader import Bag
from offradar_ros.recordings.bags.scan_topic import scan_topic
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.datasets.check.findings import counted
from offradar_ros.recordings.drive import POSITION_TYPES, DriveResult
from offradar_ros.recordings.drive import drive as drive_through
from offradar_ros.recordings.truth import errors_m, on_map, true_poses
from offradar_ros.records import require_writable
from offradar_ros.types import Match, PlaceTable, Reason, Rejection

INTERRUPTED = 130


def drive(
    bag: Annotated[Path, typer.Argument(help='rosbag2 folder or file.')],
    params: Annotated[Optional[Path], typer.Option(help='Parameter file, as the nodes read it.')] = None,
    map_path: Annotated[Optional[Path], typer.Option('--map', help='SQLite map file; in memory if left out.')] = None,
    session: Annotated[Optional[str], typer.Option(help='Map the drive as a session of this name.')] = None,
    out: Annotated[Optional[Path], typer.Option(help='CSV file for the answers, a row for each scan.')] = None,
    topic: Topic = '',
    positions: Positions = '',
) -> None:
    """Encode, map and query every scan of a bag, exactly as the nodes do.

    Without --session the map is only read, which is possible while a map server writes it. Ctrl-C ends a session and
    keeps it.
    """
    config = load_config(params, {'map.path': str(map_path)} if map_path else None)
    if out:
        require_writable(out)
    topics = ChosenTopics(topic, positions)
    with Bag(bag) as opened:
        track_topic = _track_topic(opened, config, topics, session is not None)
        encoder = make_encoder(config.encoder)
        if session is None:
            places, origin = _read_only(config.map.path, encoder.info)
            with progress_bar(f'driving {bag.name}') as progress:
                signatures = SignatureFile(Path(config.map.path)) if config.map.path else None
                result = drive_through(
                    opened, config, encoder, places, topics=topics, signatures=signatures, progress=progress
                )
        else:
            result, origin, places = _mapped(opened, config, encoder, session, topics)
        track = _truth(opened, config, track_topic, result, origin)
        _print(result)
        if session is not None:
            _print_session(config, track_topic, result)
        for warning in result.warnings:
            typer.echo(f'warning: {warning}')
    errors = errors_m(result.outcomes, track)
    # Where the running session is searched too, its own places are near every scan.
    searched = session is not None and not config.query.exclude_current_session
    mapped = np.ones(len(errors), np.bool_) if searched else on_map(track, places.positions_m)
    recall = recall_line(result.outcomes, errors, mapped)
    if recall:
        typer.echo(recall)
    if out:
        write_answers(out, result, track, errors)
        typer.echo(f'{out}: written')
    if all(isinstance(o, Rejection) and o.reason is Reason.INVALID_EMBEDDING for o in result.outcomes):
        causes = ', '.join(f'{count} {cause}' for cause, count in sorted(result.refused.items()))
        raise DataError(f'{bag}: no scan of it could be encoded ({causes}): offradar check says why')


def _read_only(path: str, model: ModelInfo) -> tuple[PlaceTable, Optional[GeoPoint]]:
    """Places as of the last ended session, and where their frame starts; MapError if they are of another model."""
    if not path:
        return PlaceTable.from_places([], model.dimension), None
    if status_of(Path(path)) is None:
        raise MapError(f'{path}: no map file there: --session NAME starts one')
    stored = MapStore.open_read_only(Path(path))
    places = stored.committed()
    if stored.model is None or not len(places):
        return PlaceTable.from_places([], model.dimension), stored.origin
    if stored.model.fingerprint != model.fingerprint:
        raise MapError(
            f'{path}: holds embeddings of {stored.model.name} {stored.model.fingerprint[:12]}, '
            f'not of {model.name} {model.fingerprint[:12]}: use that model, or another map'
        )
    return places, stored.origin


def _mapped(
    opened: Bag, config: Config, encoder: Encoder, session: str, topics: ChosenTopics
) -> tuple[DriveResult, Optional[GeoPoint], PlaceTable]:
    """The result of a session, where the frame of the map starts, and its places before the session."""
    with (
        SessionMap(config.map) as session_map,
        progress_bar(f'driving {opened.path.name}') as draw,
        _rescued(session_map),
        _ended_by_interrupt(session_map),
        held_interrupt() as check,
    ):
        for notice in session_map.notices:
            typer.echo(notice)

        def progress(done: int, total: int) -> None:
            draw(done, total)
            check()

        before = session_map.committed()
        result = drive_through(opened, config, encoder, session_map, session=session, topics=topics, progress=progress)
        return result, session_map.origin, before


@contextlib.contextmanager
def _rescued(session_map: SessionMap) -> Iterator[None]:
    """Where the session cannot be written to its map, the whole map is written as a new file."""
    try:
        yield
    except MapError as error:
        if session_map.is_session_empty:
            raise
        rescued = session_map.rescue()
        raise MapError(f'{error}; what was mapped is kept in {rescued}' if rescued else str(error)) from error


@contextlib.contextmanager
def _ended_by_interrupt(session_map: SessionMap) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        if session_map.running_session_id is None:
            raise
        typer.echo(f'interrupted, what was mapped is kept: {session_map.end_session().summary()}')
        raise typer.Exit(INTERRUPTED) from None


def _track_topic(opened: Bag, config: Config, topics: ChosenTopics, mapped: bool) -> Optional[str]:
    """The topic of the positions; only a drive that is mapped, or for which it is chosen, cannot do without."""
    scans = scan_topic(opened, config.radar, topics.scans)
    try:
        return position_topic(opened, scans, topics.positions, POSITION_TYPES[config.position.source])
    except DataError as error:
        if mapped or topics.positions:
            raise
        typer.echo(f'note: recall is not known: {error}', err=True)
        return None


def _truth(
    opened: Bag, config: Config, topic: Optional[str], result: DriveResult, origin: Optional[GeoPoint]
) -> NDArray[np.float64]:
    if topic is None:
        return np.full((len(result.outcomes), 2), np.nan)
    trajectory, _ = read_positions(opened, topic)
    return true_poses(result.outcomes, trajectory, origin, config.position)[:, :2]


def _print(result: DriveResult) -> None:
    answers = Counter('match' if isinstance(o, Match) else f'rejected: {o.reason.value}' for o in result.outcomes)
    states = Counter(found.state.value for found in result.localisations if found is not None)
    tables = (
        (('answer', 'scans'), answers),
        (('localisation', 'scans'), states),
        (('dropped', 'scans or positions'), result.refused),
    )
    for title, counts in tables:
        if counts:
            table = Table(*title)
            for name, count in sorted(counts.items()):
                table.add_row(name, str(count))
            Console().print(table)


def _print_session(config: Config, positions: Optional[str], result: DriveResult) -> None:
    report = result.report
    if report is None:
        return
    typer.echo(report.summary())
    if report.inserted + report.replaced + report.kept == 0:
        causes = ', '.join(f'{counted(count, "scan")} {cause}' for cause, count in sorted(report.dropped.items()))
        causes = causes or 'no scan could be read'
        wanted = POSITION_TYPES[config.position.source]
        if positions is None:
            causes = f'the bag has no {wanted}, which position.source: {config.position.source} asks for'
        typer.echo(f'note: nothing was mapped: {causes}')
