"""Whether recorded scans find their places, and what the gate answers on the map and off it: see README.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from recorded_answers import Answers, answer, encode, print_head, print_row, table_of
from recorded_bay import print_bay
from recorded_scans import Positions, bay_sessions, car_park, car_park_motions, evenly_spaced, positions
from scan_sources import read_arguments, recorded_sources

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.types import Embedding, PolarScan

ENCODERS = {'compact': EncoderConfig(), 'ring_key': EncoderConfig(name='ring_key')}
MAPPED, QUERIED = slice(0, 26), slice(33, 42)
PASSED_BEFORE = 12
"""The first scans of the car park's map, which pass the building that the queries pass the other way."""
_APART_M = 1e6
_BAY_BIN_M = 2.0


def car_park_answers(encoder: Encoder, scans: list[PolarScan], at_m: Positions) -> Answers:
    """The way back as queries of a map of the way there and the turn."""
    embeddings = encode(encoder, scans)
    return answer(table_of(embeddings[MAPPED], at_m[MAPPED]), embeddings[QUERIED], at_m[QUERIED])


def print_car_park(real: Path, encoders: dict[str, Encoder]) -> None:
    """The way back through a car park, on the map, and where only the turn is mapped."""
    scans = car_park(real)
    motions = car_park_motions(scans)
    at_m = positions(motions)
    ways = {'way there': slice(0, PASSED_BEFORE), 'turn': slice(PASSED_BEFORE, MAPPED.stop), 'way back': QUERIED}
    print_head('car park', 'scans', 'forward of the first scan', 'right', 'heading')
    for name, which in ways.items():
        turns = np.rad2deg([motion.turn_rad for motion in motions[which]])
        ends = (at_m[which][[0, -1]].T, turns[[0, -1]][np.newaxis])
        print_row(name, len(turns), *(f'{first:.0f} to {last:.0f}' for part in ends for first, last in part))
    print_head('encoder', 'of the way there', 'within 25 m', 'answered', 'p_right of each', 'distance', 'U')
    for name, encoder in encoders.items():
        found = car_park_answers(encoder, scans, at_m)
        p_right = ', '.join(f'{value:.2f}' for value in found.p_right)
        means = (f'{values.mean():.2f}' for values in (found.distance, found.uncertainty))
        counts = (found.row < PASSED_BEFORE, found.right, found.answered)
        print_row(name, *(f'{count.sum()} of {len(count)}' for count in counts), p_right, *means)


def recordings(real: Path) -> dict[str, list[PolarScan]]:
    """Up to 18 scans of each recording that is a place of its own."""
    own = {'bay, session 1': evenly_spaced(bay_sessions(real)[1][::6], _BAY_BIN_M), 'car park': car_park(real)[::3]}
    return dict(recorded_sources(real, 18)) | own


def recording_answers(embeddings: dict[str, list[Embedding]], name: str, mapped: bool) -> Answers:
    """The scans of a recording but its first one, as queries of a map of all other recordings.

    If `mapped`, the map has the first scan, too. Recordings are 1000 km apart, and each one is at one position.
    """
    others = [scan for other, scans in embeddings.items() if other != name for scan in scans]
    number = [row for row, other in enumerate(embeddings) if other != name for _ in embeddings[other]]
    own = list(embeddings).index(name)
    scans, places = (others + embeddings[name][:1], [*number, own]) if mapped else (others, number)
    queries = embeddings[name][1:] if mapped else embeddings[name]
    at_m = np.stack([np.array(places) * _APART_M, np.zeros(len(places))], axis=1)
    return answer(table_of(scans, at_m), queries, np.full((len(queries), 2), (own * _APART_M, 0.0)))


def print_recordings(real: Path, encoders: dict[str, Encoder]) -> None:
    """Every recording as queries of the others, with its first scan in the map and without."""
    scans = recordings(real)
    for name, encoder in encoders.items():
        embeddings = {source: encode(encoder, found) for source, found in scans.items()}
        print_head(name, 'queries', 'right', 'answered', 'distance', 'off: queries', 'answered', 'distance', 'p_right')
        for source, found in embeddings.items():
            off = recording_answers(embeddings, source, mapped=False)
            cells = (len(off.row), int(off.answered.sum()), f'{off.distance.min():.2f}', f'{off.p_right.max():.3f}')
            if len(found) == 1:
                print_row(source, 0, '', '', '', *cells)
                continue
            on = recording_answers(embeddings, source, mapped=True)
            counts = (int(on.right.sum()), int((on.right & on.answered).sum()), f'{on.distance.max():.2f}')
            print_row(source, len(on.row), *counts, *cells)


def main() -> None:
    """Print tables in Markdown."""
    real = read_arguments(__doc__ or '').real
    encoders = {name: make_encoder(config) for name, config in ENCODERS.items()}
    print_bay(real, encoders)
    print_car_park(real, encoders)
    print_recordings(real, encoders)


if __name__ == '__main__':
    main()
