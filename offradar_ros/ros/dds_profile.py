"""The Fast DDS profile that comes with us: shared memory large enough for scans."""

from __future__ import annotations

from collections.abc import Mapping

from offradar_ros.shipped import installed_file

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""What Jazzy's Fast DDS 2.14 reads when a process makes its first node; not the FASTDDS_ one of later."""


def with_profile(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment with our profile, unless it names one already or ours is not installed: all works without."""
    ours = installed_file('fastdds.xml')
    if environment.get(VARIABLE) or ours is None:
        return dict(environment)
    return {**environment, VARIABLE: str(ours)}
