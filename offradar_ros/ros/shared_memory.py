"""Whether the shared memory of the machine has room for a process of ROS."""

from __future__ import annotations

import os

FOLDER = '/dev/shm'
NEEDED_BYTES = 64 * 1024
"""With less than two pages left, libraries of ROS end the process (SIGBUS) when they are loaded. With more they start,
and go over to UDP where their own memory does not fit."""


def shared_memory_problem(folder: str = FOLDER) -> str:
    """Why a process of ROS would not start, and what to do; empty if it would. To be asked before rclpy is imported."""
    try:
        state = os.statvfs(folder)
    except OSError:
        return ''
    if state.f_bavail * state.f_frsize >= NEEDED_BYTES or not state.f_blocks:
        return ''
    return (
        f'{folder}: the shared memory is full, and ROS cannot start: remove what processes that were killed have left '
        f'there (rm {folder}/fastrtps_* while no node runs), or give the container more (docker run --shm-size=256m, '
        'or --ipc=host)'
    )
