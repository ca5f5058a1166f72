"""Weather from the text of a command-line option."""

from __future__ import annotations

from offradar_ros.errors import ConfigError
from offradar_ros.lab.simulation.weather import CLEAR, Weather

_BOUNDS = {'rain': (0.0, 150.0), 'snow': (0.0, 10.0), 'fog': (5.0, 100_000.0)}
_FIELDS = {'rain': 'rain_mm_h', 'snow': 'snow_mm_h', 'fog': 'fog_visibility_m'}


def parse_weather(text: str) -> Weather:
    """``clear``, or some of ``rain=MM_H``, ``snow=MM_H`` and ``fog=VISIBILITY_M``, separated by commas.

    ConfigError for other text and for numbers outside 0 to 150, 0 to 10 and 5 to 100,000.
    """
    if text == 'clear':
        return CLEAR
    values = {}
    for part in text.split(','):
        name, _, number = part.strip().partition('=')
        try:
            low, high = _BOUNDS[name]
            value = float(number)
        except (KeyError, ValueError):
            raise _refusal(text) from None
        if not low <= value <= high:
            raise ConfigError(f'weather {name}: expected {low:g} to {high:g}, got {number}')
        values[_FIELDS[name]] = value
    return Weather(**values)


def _refusal(text: str) -> ConfigError:
    return ConfigError(f'weather {text!r}: expected clear, or rain=MM_H, snow=MM_H and fog=VISIBILITY_M with commas')
