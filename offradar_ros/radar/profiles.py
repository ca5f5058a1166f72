"""The range resolution, in metres for each bin: polar images do not carry it, it depends on sensor and settings."""

from __future__ import annotations

import dataclasses

from offradar_ros.config import RadarConfig
from offradar_ros.errors import RefusedInput


@dataclasses.dataclass(frozen=True)
class SensorProfile:
    """A spinning radar with the settings of one source; the profile `auto` recognises it by `range_bins`."""

    name: str
    range_resolution_m: float
    range_bins: int
    azimuths: int
    description: str


# cts350x: the constant in the tools of the Oxford data set (the sensor's data sheet has 0.0438 m).
# navtech_300m: nominal, 6848 bins to 300 m; the driver's configuration message (`bin_size`, in 1e-4 m) or
# radar.range_resolution_m is exact.
PROFILES: dict[str, SensorProfile] = {
    profile.name: profile
    for profile in (
        SensorProfile('cts350x', 0.0432, 3768, 400, 'Navtech CTS350-X as in Oxford Radar RobotCar, 163 m'),
        SensorProfile('cir204h', 0.0595238, 3360, 400, 'Navtech CIR204-H as in MulRan, 200 m'),
        SensorProfile('radiate', 0.1736, 576, 400, 'Navtech CTS350-X as in RADIATE, 100 m'),
        SensorProfile('navtech_300m', 0.0438, 6848, 400, 'Navtech with 6848 bins, nominally 300 m'),
    )
}


def range_resolution(config: RadarConfig, range_bins: int) -> float:
    """Metres for each bin: `radar.range_resolution_m` if set, else from the named profile, else by the number of bins.

    The number of bins identifies recorded formats only. A live Navtech driver may be set to any number (2856, for
    example); then one of the two parameters is needed. RefusedInput('unknown_range_resolution') says so.
    """
    if config.range_resolution_m > 0.0:
        return config.range_resolution_m
    if config.profile in PROFILES:
        return PROFILES[config.profile].range_resolution_m
    if config.profile == 'auto':
        for profile in PROFILES.values():
            if profile.range_bins == range_bins:
                return profile.range_resolution_m
    known = ', '.join(f'{p.range_bins} ({p.name})' for p in PROFILES.values())
    reason = (
        'radar.profile is custom'
        if config.profile == 'custom'
        else f'{range_bins} range bins match none of the known formats: {known}'
    )
    raise RefusedInput(
        'unknown_range_resolution', f'{reason}; set radar.range_resolution_m (metres for each bin) or radar.profile'
    )
