"""Spinning a node for a time, or until a condition holds."""

from __future__ import annotations

import time
from collections.abc import Callable

import rclpy
from rclpy.node import Node

POLL_S = 0.1


def spin_for(node: Node, seconds: float) -> None:
    """Handle callbacks for `seconds`."""
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        rclpy.spin_once(node, timeout_sec=left_s)


def spin_until(node: Node, done: Callable[[], bool], timeout_s: float) -> bool:
    """Handle callbacks until `done()`, checked after each one and every 0.1 s; False if `timeout_s` passes before."""
    end_s = time.monotonic() + timeout_s
    while not done():
        left_s = end_s - time.monotonic()
        if left_s <= 0:
            return False
        rclpy.spin_once(node, timeout_sec=min(left_s, POLL_S))
    return True
