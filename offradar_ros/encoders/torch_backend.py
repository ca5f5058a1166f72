"""Runs safetensors weights with torch, on a GPU if there is one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from offradar_ros.encoders.device import torch_device
from offradar_ros.encoders.image_encoder import ImageEncoder
from offradar_ros.encoders.networks.files import load_network


class TorchEncoder(ImageEncoder):
    """Learned encoder in torch; ModelError for invalid weights."""

    def __init__(self, path: str | Path, threads: int = 0, device: str = 'auto') -> None:
        """`threads` sets torch's threads for the whole process, 0 leaves them; `device` as `encoder.device`.

        ConfigError for ``cuda`` without a GPU.
        """
        self._device = torch.device(torch_device(device, torch.__version__, torch.cuda.is_available()))
        network, header = load_network(path)
        super().__init__(header, path, self._device.type)
        if threads:
            torch.set_num_threads(threads)
        self._network = network.to(self._device)
        self.require_sound()

    def infer(self, images: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Images (N, H, W) uint8 → mean and variance, both (N, d) float32."""
        with torch.inference_mode():
            mean, variance = self._network.embed(torch.from_numpy(np.ascontiguousarray(images)).to(self._device))
        return mean.cpu().numpy(), variance.cpu().numpy()
