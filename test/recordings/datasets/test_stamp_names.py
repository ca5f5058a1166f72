from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from offradar_ros.recordings.datasets.stamp_names import parse_stamp_ns, stamp_of_name


@pytest.mark.parametrize(
    ('text', 'stamp_ns'),
    [
        ('1574859771.744660272', 1_574_859_771_744_660_272),
        ('1547131046353', 1_547_131_046_353_000_000),
        ('1547131046353776', 1_547_131_046_353_776_000),
        ('0001547131010502681', 1_547_131_010_502_681_000),
        ('1567410201563630080', 1_567_410_201_563_630_080),
        (' 1630597331060160.0 ', 1_630_597_331_060_160_000),
        ('1.567410201563630080e18', 1_567_410_201_563_630_080),
    ],
)
def test_the_magnitude_shows_the_unit(text: str, stamp_ns: int) -> None:
    assert parse_stamp_ns(text) == stamp_ns


@pytest.mark.parametrize(
    'text', ['', 'x', 'nan', 'inf', '-1567410201563630080', '0', '12345', '1e30', '1e999999999', '9' * 40]
)
def test_others_are_no_stamps(text: str) -> None:
    with pytest.raises(ValueError, match='not a'):
        parse_stamp_ns(text)


@given(st.integers(10**17, 2**63 - 1))
def test_nanoseconds_are_exact(stamp_ns: int) -> None:
    assert parse_stamp_ns(str(stamp_ns)) == stamp_ns


@given(st.text(max_size=30))
def test_any_text_is_a_stamp_or_a_value_error(text: str) -> None:
    with contextlib.suppress(ValueError):
        assert 0 < parse_stamp_ns(text) < 2**63


def test_file_names() -> None:
    assert stamp_of_name(Path('radar/1547131046353776.png')) == 1_547_131_046_353_776_000
    assert stamp_of_name(Path('polar/1567410201563630080.png')) == 1_567_410_201_563_630_080
    for name in ('000000.png', 'test_frame.png', '1547131046.png', '٣' * 19 + '.png', '9' * 30 + '.png'):
        assert stamp_of_name(Path(name)) is None
