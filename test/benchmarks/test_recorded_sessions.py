"""Recorded scans that no network has seen: a marine radar in a bay, a car park, and single drives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_answers import encode
from recorded_bay import Bay, coefficients_by, see_bay
from recorded_scans import (
    BAY_BINS,
    Positions,
    Power,
    bay_motions,
    bay_scores,
    bay_sessions,
    car_park,
    car_park_motions,
    positions,
)
from recorded_sessions import PASSED_BEFORE, car_park_answers, recording_answers, recordings

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.registry import make_encoder


@pytest.fixture(scope='module')
def compact() -> Encoder:
    pytest.importorskip('onnxruntime')
    return make_encoder(EncoderConfig())


@pytest.fixture(scope='module')
def sessions(real_data: Path) -> dict[int, Power]:
    found = bay_sessions(real_data)
    return found | {3: found[3][::4]}


@pytest.fixture(scope='module')
def places(sessions: dict[int, Power]) -> dict[int, Positions]:
    return {session: positions(motions) for session, motions in bay_motions(sessions).items()}


@pytest.fixture(scope='module')
def bay(compact: Encoder, sessions: dict[int, Power], places: dict[int, Positions]) -> Bay:
    """With bins of 2 m, which fill the network's image to its edge."""
    return see_bay(compact, sessions, places, 2.0, BAY_BINS)


def test_the_third_session_starts_in_the_bay_and_leaves_it(
    sessions: dict[int, Power], places: dict[int, Positions]
) -> None:
    """The folder's notes call it another place; its first scans fit those of session 1, and their mirror images not."""
    scores = bay_scores({**sessions, 2: sessions[2][:1]})
    assert scores['session 3, first tenth'].min() > scores['session 3, first tenth, mirrored'].max()
    away = np.hypot(*places[3].T)
    assert away[0] < 10.0
    assert away[-1] > 60.0
    # Nothing jumps: ten seconds lie between these scans.
    assert np.hypot(*np.diff(places[3], axis=0).T).max() < 10.0


def test_the_second_session_finds_its_place(bay: Bay) -> None:
    """The target: .95 are answered right at the default gate. The map is sessions 1 and 3, by their positions."""
    found = bay.answers(bay.map_of(1, 3), 2)
    assert len(found.row) == 73
    assert (found.right & found.answered).mean() >= 0.95
    assert not (~found.right & found.answered).any()


def test_scans_off_the_map_are_rejected(bay: Bay) -> None:
    """The target: at most .01 of session 3 are answered from a map of session 1; of what lies beyond 50 m, none is."""
    table = bay.map_of(1)
    second, third = bay.answers(table, 2), bay.answers(table, 3)
    assert third.off_map.sum() > 100
    assert third.answered[third.off_map].mean() <= 0.01
    assert second.answered.mean() >= 0.95
    assert second.distance.max() < third.distance[third.off_map].min()
    # A month later, at the same place.
    assert third.answered[third.on_map].mean() > 0.7


def test_a_drive_that_goes_on_where_the_map_ends(bay: Bay) -> None:
    found = bay.third_session_alone()
    assert found.right[found.on_map].mean() >= 0.95
    assert found.answered[found.off_map].mean() <= 0.01


@pytest.mark.parametrize('bin_m', [1.0, 2.0])
def test_a_map_of_one_place_needs_its_own_unrelated_distance(
    compact: Encoder, sessions: dict[int, Power], places: dict[int, Positions], bin_m: float
) -> None:
    """All of session 1 at one position, as if positions were not known: no place is elsewhere.

    The target, at most .01 answered off the map, is missed by far with the typical distance that ships, although the
    distances separate. It is reached with the median distance between the scans of the map.
    """
    bay = see_bay(compact, sessions, places, bin_m, BAY_BINS)
    second, third = bay.answers_as_one_place(2), bay.answers_as_one_place(3)
    assert second.answered.all()
    assert not third.spatial_ratio.any()
    assert second.distance.max() < third.distance[third.off_map].min()
    config = coefficients_by(compact, bay.map_of(1))['unrelated distance, median']
    second, third = bay.answers_as_one_place(2, config), bay.answers_as_one_place(3, config)
    assert second.answered.mean() >= 0.95
    assert third.answered[third.off_map].mean() <= 0.01


def test_a_car_park_driven_the_other_way(real_data: Path, compact: Encoder) -> None:
    """Known: 4 of 9 find a scan of the way there. None is probable enough to be answered, the right ones included."""
    scans = car_park(real_data)
    motions = car_park_motions(scans)
    turned = np.rad2deg(motions[35].turn_rad - motions[5].turn_rad) % 360.0
    assert turned == pytest.approx(186.0, abs=10.0)
    found = car_park_answers(compact, scans, positions(motions))
    assert (found.row < PASSED_BEFORE).sum() >= 4
    assert found.right.sum() >= 7
    assert not (found.answered & ~found.right).any()


def test_each_recording_is_known_once_its_first_scan_is_mapped(real_data: Path, compact: Encoder) -> None:
    embeddings = {name: encode(compact, scans) for name, scans in recordings(real_data).items()}
    off = [recording_answers(embeddings, name, mapped=False) for name in embeddings]
    assert not np.concatenate([answers.answered for answers in off]).any()
    drives = [name for name, scans in embeddings.items() if len(scans) > 1]
    on = [recording_answers(embeddings, name, mapped=True) for name in drives]
    assert len(on) == 5
    assert np.concatenate([answers.right for answers in on]).all()
    assert np.concatenate([answers.answered for answers in on]).mean() > 0.7
