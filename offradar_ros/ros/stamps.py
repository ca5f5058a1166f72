"""Nanoseconds to and from message headers."""

from builtin_interfaces.msg import Time
from std_msgs.msg import Header


def time_message(stamp_ns: int) -> Time:
    """builtin_interfaces/Time of a stamp in nanoseconds."""
    return Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)


def header(stamp_ns: int, frame_id: str) -> Header:
    """Header with the stamp of the scan that the message is about."""
    return Header(stamp=time_message(stamp_ns), frame_id=frame_id)
