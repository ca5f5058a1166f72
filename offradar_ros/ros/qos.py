"""Quality of service of every topic; each can be overridden by the standard ``qos_overrides`` parameters."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def _reliable(depth: int, durability: DurabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability
    )


# Best effort loses scans: 1.5 MB is several times a shared-memory segment and travels in fragments.
SCANS = _reliable(5, DurabilityPolicy.VOLATILE)
# A replay in lockstep sends the positions of several seconds at once, at up to 200 a second.
POSITIONS = _reliable(2000, DurabilityPolicy.VOLATILE)
RESULTS = _reliable(10, DurabilityPolicy.VOLATILE)
# A subscriber that misses one would hold another map than the server.
UPDATES = _reliable(1000, DurabilityPolicy.VOLATILE)
# Of more requests that wait than this, the oldest are never answered; by default that is 10.
SERVICES = _reliable(1000, DurabilityPolicy.VOLATILE)
LATCHED = _reliable(1, DurabilityPolicy.TRANSIENT_LOCAL)
