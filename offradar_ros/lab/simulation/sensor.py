"""Size of the scans that the simulated radar records."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class SimulatedSensor:
    """The size of a scan; the default is a Navtech at 400 × 576 bins, as in the RADIATE data set.

    Attributes:
        azimuths: rows of a scan; row k points k/azimuths of a turn clockwise from forward.
        range_bins: columns of a scan.
        range_resolution_m: size of a bin.
        rotation_s: time of one rotation.
    """

    azimuths: int = 400
    range_bins: int = 576
    range_resolution_m: float = 0.1736
    rotation_s: float = 0.25

    @property
    def max_range_m(self) -> float:
        """Far edge of the last bin, metres."""
        return self.range_bins * self.range_resolution_m


TRAINING_SENSOR = SimulatedSensor(range_bins=512, range_resolution_m=0.32)
"""Up to 164 m, as a Navtech CTS350-X: recall increases with range. A column of the compact image is four bins."""
