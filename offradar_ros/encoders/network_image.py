"""The input image of a network: training and vehicle make it by the same code, which is here."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from offradar_ros.config import CartesianConfig
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.radar.cartesian import PolarToCartesian
from offradar_ros.radar.polar_grid import PolarToGrid
from offradar_ros.types import PolarScan


def make_image(config: NetworkConfig) -> Callable[[PolarScan], NDArray[np.uint8]]:
    """A function from a scan to the uint8 image of `config`, of shape `config.image_shape`.

    It keeps look-up tables between scans and is not thread-safe.
    """
    image = config.image
    return PolarToCartesian(image) if isinstance(image, CartesianConfig) else PolarToGrid(image)
