"""Names and numbers as the tables of a report have them."""

from __future__ import annotations

import math

from offradar_ros.encoders.registry import ENCODERS
from offradar_ros.lab.evaluation.methods import METHODS, OURS

METHOD_NAMES = {name: ENCODERS[encoder].title for name, encoder in METHODS.items()}
METHOD_NAMES |= {OURS: f'{METHOD_NAMES[OURS]}(O)', f'{OURS} (M)': f'{METHOD_NAMES[OURS]}(M)'}
"""Methods by the names of the paper's tables; other methods have the name of the results."""


def method_label(method: str) -> str:
    """The name of a method, without (O)."""
    return METHOD_NAMES.get(method, method).replace('(O)', '')


def percent(value: float) -> str:
    """A share in percent with two decimals; a dash for NaN."""
    return '-' if math.isnan(value) else f'{100.0 * value:.2f}'


def spacing_label(spacing: str) -> str:
    """The density of a map, from the key of its spacing."""
    return 'every scan mapped' if float(spacing) == 0.0 else f'a map every {spacing} m'
