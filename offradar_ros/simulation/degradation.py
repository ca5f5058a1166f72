"""What spoils a scan, by how much, and on which azimuths: part of the ground truth."""

from __future__ import annotations

import dataclasses
import enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]

_OVERDRIVEN = np.float32(10.0**4.5)


class DegradationKind(str, enum.Enum):
    """Faults that the uncertainty should rise for."""

    BLOCKED = 'blocked'
    FLOODED = 'flooded'
    SATURATED = 'saturated'


@dataclasses.dataclass(frozen=True)
class Degradation:
    """One scan's fault; `severity` 0 to 1, `azimuth` the row where it starts."""

    kind: DegradationKind
    severity: float
    azimuth: int


def degrade(signal: Array, noise: Array, degradation: Degradation, cells_to_near: int) -> tuple[Array, Array]:
    """Linear `signal` and `noise` (A, C) with the fault in them.

    * blocked: a lorry or dirt hides up to half of the rotation and shows as a return in cell `cells_to_near`.
    * flooded: another transmitter lifts the noise by up to 30 dB.
    * saturated: up to a quarter of the azimuths, every seventh from the first, are overdriven over their whole range.
    """
    azimuths, severity = len(signal), degradation.severity
    if degradation.kind is DegradationKind.BLOCKED:
        rows = (degradation.azimuth + np.arange(round(0.5 * severity * azimuths))) % azimuths
        signal = signal.copy()
        signal[rows] *= np.float32(1e-3)
        signal[rows, cells_to_near : cells_to_near + 3] += _OVERDRIVEN
    elif degradation.kind is DegradationKind.FLOODED:
        noise = noise * np.float32(10.0 ** (3.0 * severity))
    else:
        rows = (degradation.azimuth + 7 * np.arange(round(0.25 * severity * azimuths))) % azimuths
        noise = noise.copy()
        noise[rows] += _OVERDRIVEN
    return signal, noise
