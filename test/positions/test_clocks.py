"""The clocks of radar and positions, from when messages arrive."""

from __future__ import annotations

import numpy as np
import pytest

from offradar_ros.positions.clocks import ArrivalClocks, clock_problem, known_offset

SECOND = 10**9
NOW = 1_767_225_600 * SECOND


def heard(
    radar_s: float, receiver_s: float, *, rate: float = 1.0, jitter_s: float = 0.05, odd: int = 0, count: int = 100
) -> ArrivalClocks:
    """Scans at 4 Hz and positions at 5 Hz whose stamps are their true time plus these seconds."""
    rng = np.random.default_rng(0)
    clocks = ArrivalClocks()
    events = [(k / 4, 'scan', radar_s, 0.3) for k in range(count)] + [
        (k / 5, 'position', receiver_s + (6e8 if k < odd else 0.0), 0.1) for k in range(count * 5 // 4)
    ]
    for time_s, kind, error_s, latency_s in sorted(events):
        arrival_ns = round((time_s / rate + latency_s + rng.uniform(0.0, jitter_s)) * SECOND)
        stamp_ns = NOW + round((time_s + error_s) * SECOND)
        (clocks.add_scan if kind == 'scan' else clocks.add_position)(arrival_ns, stamp_ns)
    return clocks


@pytest.mark.parametrize(
    ('radar_s', 'receiver_s', 'add_s'),
    [
        (37.0, 0.0, 37.0),
        (-37.0, 0.0, -37.0),
        (18.0, 0.0, 18.0),
        (0.0, 18.0, -18.0),
        (2.5, 0.0, 2.5),
        (-NOW / 1e9, 0.0, -NOW / 1e9),
    ],
)
def test_an_offset_is_what_to_add_to_positions(radar_s: float, receiver_s: float, add_s: float) -> None:
    found = heard(radar_s, receiver_s).offset_s()
    assert found == pytest.approx(add_s, abs=0.4)


@pytest.mark.parametrize('rate', [0.5, 1.0, 2.0])
def test_clocks_that_agree_raise_no_alarm_at_any_rate_of_replay(rate: float) -> None:
    assert clock_problem(heard(0.0, 0.0, rate=rate).offset_s()) == ''
    assert clock_problem(heard(37.0, 37.0, rate=rate).offset_s()) == ''


def test_a_few_odd_stamps_do_not_count() -> None:
    assert clock_problem(heard(0.0, 0.0, odd=10).offset_s()) == ''
    assert heard(37.0, 0.0, odd=10).offset_s() == pytest.approx(37.0, abs=0.4)


def test_few_messages_and_clocks_that_run_apart_say_nothing() -> None:
    assert ArrivalClocks().offset_s() is None
    assert heard(37.0, 0.0, count=5).offset_s() is None
    clocks = ArrivalClocks()
    for k in range(100):
        clocks.add_position(k * SECOND // 4, NOW + k * SECOND // 4)
        clocks.add_scan(k * SECOND // 4, NOW + k * SECOND)
    assert clocks.offset_s() is None


@pytest.mark.parametrize(
    ('offset_s', 'why', 'option'),
    [
        (-37.2, '(TAI is 37 s ahead of UTC)', '-37.0'),
        (18.3, '(GPS time is 18 s ahead of UTC)', '18.0'),
        (-19.1, '(TAI is 19 s ahead of GPS time)', '-19.0'),
        (7200.2, '(as time zones do)', '7200.0'),
        (1024 * 7 * 86400.0 + 0.2, '(a GPS week number that has rolled over: 1024 weeks)', '619315200.0'),
        (-315_964_782.3, '(GPS time counts from 1980, and is 18 s ahead of UTC)', '-315964782.0'),
        (2.5, 'says their arrival: ', '2.5'),
        (29 * 1800.0, 'says their arrival: ', '52200.0'),
    ],
)
def test_the_option_that_corrects_it(offset_s: float, why: str, option: str) -> None:
    text = clock_problem(offset_s)
    assert why in text
    assert text.endswith(f'offradar convert --position-offset-s {option}')
    assert '\n' not in text


@pytest.mark.parametrize('offset_s', [None, 0.0, 0.9, -0.9])
def test_latencies_are_no_offset(offset_s: float | None) -> None:
    assert clock_problem(offset_s) == ''


def test_a_position_that_arrived_long_ago_is_not_compared() -> None:
    clocks = ArrivalClocks()
    clocks.add_position(0, NOW)
    for k in range(10, 50):
        clocks.add_scan(k * SECOND, NOW + k * SECOND)
    assert clocks.offset_s() is None


def test_a_clock_that_was_set_meanwhile_is_forgotten() -> None:
    clocks = ArrivalClocks()
    for k in range(1000):
        clocks.add_position(k * SECOND // 4, NOW + k * SECOND // 4 - (37 * SECOND if k < 600 else 0))
        clocks.add_scan(k * SECOND // 4, NOW + k * SECOND // 4)
    assert clocks.offset_s() == 0.0


def test_the_option_includes_what_was_given() -> None:
    assert clock_problem(2.5, given_s=18.0).endswith(' --position-offset-s 20.5')


@pytest.mark.parametrize('offset_s', [0.6, 1801.5, -3605.0])
def test_an_offset_that_is_not_near_a_time_zone_is_none(offset_s: float) -> None:
    text = clock_problem(offset_s, least_s=0.5)
    assert 'time zones' not in text
    assert text.endswith(f' {offset_s:.1f}')


@pytest.mark.parametrize(
    ('lowest_s', 'highest_s', 'expected_s'),
    [
        (36.0, 38.0, 37.0),
        (-38.0, -36.0, -37.0),
        (17.0, 20.0, None),
        (-7201.0, -7199.0, -7200.0),
        (1024 * 7 * 86400.0 - 1.0, 1024 * 7 * 86400.0 + 1.0, 1024 * 7 * 86400.0),
        (315_964_799.0, 315_964_801.0, 315_964_800.0),
        (315_964_700.0, 315_964_900.0, None),
        (100.0, 200.0, None),
    ],
)
def test_an_offset_is_known_where_bounds_hold_one_only(
    lowest_s: float, highest_s: float, expected_s: float | None
) -> None:
    found = known_offset(lowest_s, highest_s)
    assert (found[0] if found else None) == expected_s
