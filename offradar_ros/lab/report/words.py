"""Words and numbers as a report's tables have them."""

from __future__ import annotations

import math

from offradar_ros.encoders.registry import ENCODERS
from offradar_ros.lab.evaluation.methods import METHODS, OURS

NAMES = {name: ENCODERS[encoder].title for name, encoder in METHODS.items()}
NAMES |= {OURS: f'{NAMES[OURS]}(O)', f'{OURS} (M)': f'{NAMES[OURS]}(M)'}
"""As the paper's tables call them; others go by their own name."""


def name_of(method: str) -> str:
    """A method where nothing is said of its map."""
    return NAMES.get(method, method).replace('(O)', '')


def percent(value: float | None) -> str:
    """A share as percent with two decimals, a dash for what could not be measured."""
    return '-' if value is None or math.isnan(value) else f'{100.0 * value:.2f}'


def map_words(spacing: str) -> str:
    """How dense a map is, from the key of its spacing."""
    return 'every scan mapped' if float(spacing) == 0.0 else f'a map every {spacing} m'
