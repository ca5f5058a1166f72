"""A district's measures along streets of one kind."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.simulation.city.style import Style
from offradar_ros.lab.simulation.streets import StreetKind


def along_street(style: Style, kind: StreetKind) -> Style:
    """Houses stand close to narrow streets; open roads have guard rails, and little else near them."""
    if kind is StreetKind.NARROW:
        return dataclasses.replace(style, setback_m=0.5 * style.setback_m, rails=0.0, trees=0.5 * style.trees)
    if kind is StreetKind.OPEN_ROAD:
        return dataclasses.replace(
            style,
            built=0.4 * style.built,
            setback_m=style.setback_m + 6.0,
            rails=1.0,
            hedges=0.3 * style.hedges,
            poles_m=1.5 * style.poles_m,
            parking=0.0,
        )
    return style
