"""Navtech's messages, if `navtech_msgs` is installed: encoder angles of every row, and the sensor's settings.

RadarBScanMsg carries the image, `encoder_values` and `timestamps` (ns) a row; RadarConfigurationMessage carries
`bin_size` in units of 1e-4 m.
"""

from __future__ import annotations

import dataclasses
import importlib
from typing import Any

import numpy as np

from offradar_ros.config import RadarConfig
from offradar_ros.errors import ConfigError, RefusedInput
from offradar_ros.messages import scan_from_image
from offradar_ros.radar.image import scan_from_rows
from offradar_ros.radar.navtech_rows import measured_rows
from offradar_ros.records import replace
from offradar_ros.types import PolarScan

BIN_SIZE_UNIT_M = 1e-4


def message_types() -> tuple[type, type] | None:
    """RadarBScanMsg and RadarConfigurationMsg, or None where navtech_msgs is not installed."""
    try:
        messages = importlib.import_module('navtech_msgs.msg')
    except ImportError:
        return None
    configuration = getattr(messages, 'RadarConfigurationMsg', None) or getattr(
        messages, 'RadarConfigurationMessage', None
    )
    scan = getattr(messages, 'RadarBScanMsg', None)
    return (scan, configuration) if scan and configuration else None


def configured(config: RadarConfig, message: Any) -> RadarConfig:
    """The radar configuration with the settings that the sensor reports; an explicit bin size or range offset wins.

    RefusedInput('wrong_configuration') for settings that could not be parameters: they would spoil every later scan.
    """
    resolution_m = float(message.bin_size) * BIN_SIZE_UNIT_M * float(message.range_gain or 1.0)
    if not 0.0 < resolution_m < 10.0 or not message.azimuth_samples or not message.encoder_size:
        raise RefusedInput(
            'wrong_configuration',
            f'radar configuration has bin_size {message.bin_size}, azimuth_samples {message.azimuth_samples} and '
            f'encoder_size {message.encoder_size}: expected all above zero (bin_size in 1e-4 m)',
        )
    reported = {
        'range_resolution_m': config.range_resolution_m or resolution_m,
        'range_offset_m': config.range_offset_m or float(message.range_offset),
        'azimuth_samples': int(message.azimuth_samples),
        'encoder_size': int(message.encoder_size),
    }
    try:
        return replace(config, reported, 'radar configuration:')
    except ConfigError as error:
        raise RefusedInput('wrong_configuration', str(error)) from error


def scan_from_b_scan(message: Any, config: RadarConfig) -> PolarScan:
    """The scan in a RadarBScanMsg, its rows at their encoder angles."""
    scan = scan_from_image(message.b_scan_img, dataclasses.replace(config, azimuth_axis='rows', metadata_columns='0'))
    counts = np.asarray(message.encoder_values, np.int64)
    if len(counts) != len(scan.power):
        raise RefusedInput(
            'wrong_size',
            f'RadarBScanMsg has {len(scan.power)} rows but {len(counts)} encoder values: expected as many',
        )
    # Unsigned, as in the message: as signed numbers the largest would be negative.
    given = np.asarray(message.timestamps, np.uint64)
    known = len(given) == len(counts) and bool((given < 2**63).all())
    stamps = given.astype(np.int64) if known else None
    # Without stamps, a count of 0 is that of the row at the encoder's zero.
    written = (counts != 0) | (scan.power.any(axis=1) if stamps is None else stamps != 0)
    rows = measured_rows(counts, stamps, written, scan.power, config, scan.stamp_ns)
    return scan_from_rows(scan.power, rows, scan.stamp_ns, config)
