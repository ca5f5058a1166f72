"""FFT-RadVLAD (Gadd and Newman, 2024): azimuth spectra, aggregated by the nearest of 64 centres. Needs no torch."""

from __future__ import annotations

import dataclasses

import numpy as np

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.k_means import group_sums, nearest_centres
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.rad_vlad_codebook import Codebook, load_codebook, repetition
from offradar_ros.encoders.rad_vlad_rows import spectrum_rows
from offradar_ros.errors import ConfigError
from offradar_ros.types import Embedding, PolarScan


class RadVladEncoder:
    """VLAD of a scan's azimuth spectra: the sum of residuals of each centre, signed square root, L2-normalised.

    The published descriptor has 64 × 512 values, of which 64 × 257 are distinct (see `rad_vlad_rows`); only these are
    kept, and distances are the same. Azimuths are not resized to 400: the scale of sums over azimuths cancels.

    **Variance.** The method defines no uncertainty. We use the repetition of a scan: the probability that two of its
    azimuths have the same nearest centre, divided by the mean of that over the fitted scans, the same value in every
    dimension. Differences between azimuths identify a place; noise, saturation and blocked sectors make azimuths
    similar. U is 1 on average over the fitted scans and at most the inverse of their mean probability, about 30. It
    does not recognise that one place resembles another.
    """

    runs_on = 'cpu'

    def __init__(self, codebook: Codebook) -> None:
        self.codebook = codebook
        self._rows = codebook.rows
        self._centres = codebook.centres.astype(np.float64)
        # √w: a magnitude that occurs twice has a square root that occurs twice.
        self._weights = np.sqrt(codebook.rows.weights)
        self._info = ModelInfo(
            name='rad_vlad',
            fingerprint=codebook.fingerprint,
            dimension=codebook.centres.size,
            metadata={key: f'{value}' for key, value in dataclasses.asdict(codebook.rows).items()},
        )

    @classmethod
    def from_config(cls, config: EncoderConfig) -> RadVladEncoder:
        """For the registry, from a codebook file; ConfigError for other files, ModelError for invalid ones."""
        path = find_weights(config.weights, ('.safetensors',))
        if path.suffix != '.safetensors':
            raise ConfigError(f'parameter encoder.weights: rad_vlad needs a .safetensors file, got {config.weights!r}')
        return cls(load_codebook(path))

    @property
    def info(self) -> ModelInfo:
        """The model's identity: settings and centres."""
        return self._info

    def encode(self, scan: PolarScan) -> Embedding:
        """Descriptor and variance, (centres · F,) float32; RefusedInput ``no_signal`` for a scan without power.

        A turn on the spot changes neither: sums over azimuths are exact.
        """
        rows = spectrum_rows(scan, self._rows)
        nearest, _ = nearest_centres(rows, self._centres)
        sums, sizes = group_sums(rows, nearest, len(self._centres))
        residuals = sums - sizes[:, np.newaxis] * self._centres
        vlad = (np.sign(residuals) * np.sqrt(np.abs(residuals)) * self._weights).ravel()
        length = np.sqrt(vlad @ vlad)
        silent = len(scan.power) - len(rows)
        uncertainty = repetition(sizes, silent) / self.codebook.typical_repetition
        return Embedding(
            stamp_ns=scan.stamp_ns,
            mean=(vlad / (length or 1.0)).astype(np.float32),
            variance=np.full(vlad.size, uncertainty, np.float32),
            model=self._info.fingerprint,
        )
