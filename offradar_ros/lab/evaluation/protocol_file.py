"""Protocols from YAML."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.records import read_record
from offradar_ros.shipped import shipped_file


def read_protocol(source: str | Path) -> Protocol:
    """The protocol in a YAML file, or of a name in ``params/protocols``; ConfigError says what was expected."""
    return read_record(Protocol, shipped_file('protocols', source))
