"""Tables of the bay that was recorded by a marine radar: see docs/results/recorded.md."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
from recorded_answers import SIGNALS, Answers, answer, aurocs, encode, print_head, print_row, table_of
from recorded_scans import (
    BAY_BINS,
    USABLE_BINS,
    Positions,
    Power,
    bay_motions,
    bay_scores,
    bay_sessions,
    evenly_spaced,
    positions,
)
from scipy.spatial.distance import pdist

from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.retrieval.confidence import confidence_for
from offradar_ros.types import Embedding, PlaceTable

BIN_SIZES_M = (0.75, 1.0, 1.5, 2.0, 3.0)
BANDS = ('within 25 m', '25 to 50 m', 'beyond')


class Bay(NamedTuple):
    """Sessions by number, seen by one encoder with one bin size: embeddings, and positions (scans, 2) in metres."""

    embeddings: dict[int, list[Embedding]]
    positions_m: dict[int, Positions]

    def map_of(self, *sessions: int) -> PlaceTable:
        """A map of every scan of these sessions."""
        scans = [scan for session in sessions for scan in self.embeddings[session]]
        return table_of(scans, np.concatenate([self.positions_m[session] for session in sessions]))

    def answers(self, table: PlaceTable, session: int, config: QueryConfig | None = None) -> Answers:
        """The answers to the scans of a session."""
        return answer(table, self.embeddings[session], self.positions_m[session], config)

    def answers_as_one_place(self, session: int, config: QueryConfig | None = None) -> Answers:
        """The answers from session 1 if all of its scans had one position, so that no place is elsewhere.

        Distances in metres are those from the measured positions, as without this.
        """
        table, scans = self.map_of(1), self.embeddings[session]
        measured = answer(table, scans, self.positions_m[session], config)
        together = dataclasses.replace(table, positions_m=np.zeros_like(table.positions_m))
        found = answer(together, scans, self.positions_m[session], config)
        return found._replace(error_m=measured.error_m, away_m=measured.away_m)

    def third_session_alone(self) -> Answers:
        """Every second scan of session 3 as a query; of the others, those of its first fifth are the map."""
        scans, at_m = self.embeddings[3], self.positions_m[3]
        mapped, queried = slice(0, len(scans) // 5, 2), slice(1, None, 2)
        return answer(table_of(scans[mapped], at_m[mapped]), scans[queried], at_m[queried])


Seen = dict[tuple[str, int, float], Bay]
"""The bay by encoder, number of bins read and bin size in metres."""


def see_bay(
    encoder: Encoder, sessions: dict[int, Power], positions_bins: dict[int, Positions], bin_m: float, bins: int
) -> Bay:
    """The bay with bins taken as `bin_m` metres, from the first `bins` of them."""
    embeddings = {
        session: encode(encoder, evenly_spaced(power[:, :, :bins], bin_m)) for session, power in sessions.items()
    }
    return Bay(embeddings, {session: found * bin_m for session, found in positions_bins.items()})


def coefficients_by(encoder: Encoder, places: PlaceTable) -> dict[str, QueryConfig]:
    """The coefficients that ship, and these with one value measured on the scans of a map, without any labels."""
    shipped = confidence_for(encoder.info.fingerprint, ConfidenceConfig())
    if shipped is None:
        raise ValueError(f'no coefficients ship for {encoder.info.name}')
    between = pdist(places.means.astype(np.float64))
    changed = {
        'as shipped': shipped,
        'usual U, mean': dataclasses.replace(shipped, usual_uncertainty=float(places.uncertainties.mean())),
        'unrelated distance, largest': dataclasses.replace(shipped, unrelated_distance=float(between.max())),
        'unrelated distance, median': dataclasses.replace(shipped, unrelated_distance=float(np.median(between))),
    }
    return {name: QueryConfig(confidence=coefficients) for name, coefficients in changed.items()}


def print_bay(real: Path, encoders: dict[str, Encoder]) -> None:
    """Print the tables."""
    sessions = bay_sessions(real)
    places = {session: positions(motions) for session, motions in bay_motions(sessions).items()}
    _print_motions(sessions, places)
    seen = {
        (name, bins, bin_m): see_bay(encoder, sessions, places, bin_m, bins)
        for name, encoder in encoders.items()
        for bins in ((BAY_BINS, USABLE_BINS) if name == 'compact' else (BAY_BINS,))
        for bin_m in BIN_SIZES_M
    }
    _print_found(seen)
    _print_off_map(seen)
    cut = {key: bay for key, bay in seen.items() if key[1] == BAY_BINS}
    _print_measured({key: bay for key, bay in cut.items() if key[0] == 'compact'}, encoders)
    _print_third_alone(cut)


def _print_motions(sessions: dict[int, Power], places: dict[int, Positions]) -> None:
    print_head('correlation with the middle scan of session 1', 'least', 'median', 'most')
    for name, scores in bay_scores(sessions).items():
        print_row(name, *(f'{value:.2f}' for value in np.quantile(scores, (0.0, 0.5, 1.0))))
    print_head('session', 'scans', 'bins from the middle scan of session 1: first', 'last', 'farthest')
    for session, found in places.items():
        away = np.hypot(*found.T)
        print_row(session, len(found), *(f'{value:.0f}' for value in (away[0], away[-1], away.max())))


def _print_found(seen: Seen) -> None:
    print('\nMap: sessions 1 and 3. Queries: session 2.')
    print_head('encoder', 'bins', 'bin', 'first place within 25 m', 'of session 1', 'answered, right', 'wrong')
    for (name, bins, bin_m), bay in seen.items():
        found = bay.answers(bay.map_of(1, 3), 2)
        of_first = found.row < len(bay.embeddings[1])
        masks = (found.right, of_first, found.right & found.answered, ~found.right & found.answered)
        print_row(name, bins, f'{bin_m:g} m', *(f'{mask.mean():.3f}' for mask in masks))


def _print_off_map(seen: Seen) -> None:
    print('\nMap: session 1. Queries: sessions 2 and 3. Shares that are answered; AUROC of session 3 beyond 50 m.')
    print_head('encoder', 'bins', 'bin', 'session 2', *(f'session 3, {band}' for band in BANDS), *SIGNALS)
    for (name, bins, bin_m), bay in seen.items():
        table = bay.map_of(1)
        second, third = bay.answers(table, 2), bay.answers(table, 3)
        cells = (second.share(second.on_map), *third.shares(), *aurocs(second, third))
        print_row(name, bins, f'{bin_m:g} m', *cells)


def _print_measured(seen: Seen, encoders: dict[str, Encoder]) -> None:
    print('\nThe same with values measured on session 1; also if all of session 1 had one position.')
    one = ('session 2, one position', 'beyond, one position')
    print_head('encoder', 'bins', 'bin', 'measured', 'session 2', *(f'session 3, {band}' for band in BANDS), *one)
    for (name, bins, bin_m), bay in seen.items():
        table = bay.map_of(1)
        for measured, config in coefficients_by(encoders[name], table).items():
            second, third = bay.answers(table, 2, config), bay.answers(table, 3, config)
            second_of_one, third_of_one = (bay.answers_as_one_place(session, config) for session in (2, 3))
            together = second_of_one.share(second_of_one.on_map), third_of_one.share(third_of_one.off_map)
            cells = (second.share(second.on_map), *third.shares(), *together)
            print_row(name, bins, f'{bin_m:g} m', measured, *cells)


def _print_third_alone(seen: Seen) -> None:
    print('\nMap: every second scan of the first fifth of session 3. Queries: the scans between, of all of it.')
    print_head('encoder', 'bins', 'bin', 'right, within 25 m', *BANDS, *SIGNALS)
    for (name, bins, bin_m), bay in seen.items():
        found = bay.third_session_alone()
        right = found.right[found.on_map].mean()
        print_row(name, bins, f'{bin_m:g} m', f'{right:.3f}', *found.shares(), *aurocs(found, found))
