"""Whether the positions of a data set's sequences agree: those of one place lie on one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from offradar_ros.geometry import GeoPoint, LocalFrame
from offradar_ros.recordings.datasets.check.coordinate_errors import coordinate_error
from offradar_ros.recordings.datasets.check.findings import Finding, note, ok, problem
from offradar_ros.recordings.datasets.check.route import NEAR_M, Route, nearest, route
from offradar_ros.recordings.datasets.check.scan_positions import ScanPositions

# Where a smaller share of a sequence is near another one, its coordinates are examined for an error.
_ALIGNED = 0.5
_MOST_COMPARED = 3


def check_alignment(sequences: Sequence[ScanPositions]) -> Iterator[Finding]:
    """Findings about several sequences, from the positions of their scans."""
    unlocated = [s.name for s in sequences if not s.known.any()]
    if unlocated:
        yield note(f'no scan has a position, so not compared: {", ".join(unlocated)}')
    located = [s for s in sequences if s.known.any()]
    metric = [s.name for s in located if not s.geodetic]
    geodetic = [s for s in located if s.geodetic]
    if metric and geodetic:
        yield problem(
            f'positions of {", ".join(metric)} are in metres, those of '
            f'{", ".join(s.name for s in geodetic)} in latitude and longitude: expected one kind'
        )
    elif metric:
        yield note(f'positions in metres, each sequence in its own frame, so not compared: {", ".join(metric)}')
    if len(geodetic) > 1:
        yield from _compared(geodetic)


def _compared(sequences: Sequence[ScanPositions]) -> Iterator[Finding]:
    points = {s.name: s.positions[s.known] for s in sequences}
    frame = LocalFrame(GeoPoint(*(float(v) for v in points[sequences[0].name][0, :2])))
    routes = {name: route(lla, frame) for name, lla in points.items()}
    explained: set[str] = set()
    for name, own in routes.items():
        others = _nearest_others(name, own, routes)
        (share, away_m, other), *_ = others
        text = f'{name}: {share:.0%} of its scans are within {NEAR_M:g} m of {other}'
        if share >= _ALIGNED:
            yield ok(text)
            continue
        if share == 0.0:
            distance = _distance(away_m)
            text = f'{name}: never within {NEAR_M:g} m of another sequence, the nearest is {other}, {distance} away'
        hints = ((coordinate_error(points[name], routes[to], frame), to) for _, _, to in others[:_MOST_COMPARED])
        hint, to = next(((hint, to) for hint, to in hints if hint), ('', ''))
        if hint and to not in explained:
            explained.add(name)
            yield problem(f'{text}; it fits {to} {hint}')
        elif hint:
            yield note(text)
        else:
            yield note(f'{text}: of another place, or its positions are of another frame' if share == 0.0 else text)


def _nearest_others(name: str, own: Route, routes: dict[str, Route]) -> list[tuple[float, float, str]]:
    """Share of `own` scans near each other sequence, least distance in metres, and its name; the nearest first."""
    found = []
    for other, theirs in routes.items():
        if other != name:
            away_m, _ = nearest(own.scans, theirs.line)
            found.append((float((away_m <= NEAR_M).mean()), float(away_m.min()), other))
    return sorted(found, key=lambda item: (-item[0], item[1]))


def _distance(away_m: float) -> str:
    return f'{away_m:.0f} m' if away_m < 10_000.0 else f'{away_m / 1000.0:.0f} km'
