"""The Fast DDS profile of this package: shared memory with room for scans."""

from __future__ import annotations

from collections.abc import Mapping

from offradar_ros.shipped import installed_file

VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""Read by Jazzy's Fast DDS 2.14 when a process creates its first node; later versions read a FASTDDS_ variable."""


def with_profile(environment: Mapping[str, str]) -> dict[str, str]:
    """The environment with our profile, unless it names one already or ours is not installed; nodes work without it."""
    ours = installed_file('fastdds.xml')
    if environment.get(VARIABLE) or ours is None:
        return dict(environment)
    return {**environment, VARIABLE: str(ours)}
