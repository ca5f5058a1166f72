"""What the simulated radar is."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class SimulatedSensor:
    """A spinning radar in plain numbers; the default is a Navtech at 400 × 576 bins, as in the RADIATE data set.

    Attributes:
        azimuths: rows of a scan; row k looks k/azimuths of a turn clockwise from forward.
        range_bins: columns of a scan.
        range_resolution_m: size of a bin.
        rotation_s: time of one rotation.
        beam_width_rad: half-power width of the antenna's beam.
        cell_m: range over which returns and speckle are alike, as the transmitter's bandwidth and window make it.
        noise_decibels: mean power of the receiver's noise, decibels above the recorded zero.
    """

    azimuths: int = 400
    range_bins: int = 576
    range_resolution_m: float = 0.1736
    rotation_s: float = 0.25
    beam_width_rad: float = 0.0314
    cell_m: float = 0.175
    noise_decibels: float = 3.5

    @property
    def bins_per_cell(self) -> int:
        """Range bins that are simulated as one."""
        return max(1, round(self.cell_m / self.range_resolution_m))

    @property
    def max_range_m(self) -> float:
        """Far edge of the last bin, metres."""
        return self.range_bins * self.range_resolution_m
