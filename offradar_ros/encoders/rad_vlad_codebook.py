"""The codebook of FFT-RadVLAD: its centres, and the file that stores them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from offradar_ros import __version__
from offradar_ros.bounded_input import parse_json
from offradar_ros.encoders.fingerprint import canonical_json, fingerprint
from offradar_ros.encoders.model_files import first_line, require_package, write_atomically
from offradar_ros.encoders.rad_vlad_rows import RowSettings
from offradar_ros.encoders.safetensors_file import BLANK, read_safetensors, with_digest
from offradar_ros.errors import ConfigError, ModelError
from offradar_ros.records import structure, unstructure

# Increased whenever the same settings and centres would give another embedding.
FORMULA = 1


# Lower bound, because a codebook of scans without repetition would give every other scan an infinite U.
MIN_REPETITION = 1e-3


def repetition(sizes: NDArray[np.integer], silent: int = 0) -> float:
    """Probability that two different rows are of the same group, by the sizes (K,) of the groups; 0 below two rows.

    A `silent` row counts as in the same group as any other. Unlike entropy, the probability does not depend on the
    number of rows (Simpson's index, unbiased).
    """
    counted = sizes.astype(np.float64)
    total = counted.sum() + silent
    different = counted.sum() ** 2 - (counted * counted).sum()
    return 1.0 - float(different / (total * (total - 1.0))) if total > 1.0 else 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Codebook:
    """Centres of azimuth spectra.

    Attributes:
        rows: settings of the spectra.
        centres: (K, F) float32.
        typical_repetition: mean `repetition` of the fitted scans.
        description: one line for people.
    """

    rows: RowSettings
    centres: NDArray[np.float32]
    typical_repetition: float
    description: str = ''

    @property
    def fingerprint(self) -> str:
        """SHA-256 of everything that changes an embedding."""
        return fingerprint('rad_vlad', {**self._settings(), 'formula': FORMULA}, {'centres': self.centres})

    def _settings(self) -> dict[str, int | float]:
        return {**unstructure(self.rows), 'typical_repetition': self.typical_repetition}

    def save(self, path: str | Path) -> None:
        """Write a safetensors file atomically; ModelError if it cannot be written."""
        require_package('safetensors', path)
        from safetensors.numpy import save  # noqa: PLC0415

        metadata = {
            'offradar.rad_vlad': canonical_json(self._settings()),
            'offradar.fingerprint': self.fingerprint,
            'offradar.created_by': f'offradar_ros {__version__}',
            'offradar.description': self.description,
        }
        tensors = {'centres': np.ascontiguousarray(self.centres)}
        write_atomically(path, with_digest(save(tensors, metadata={**metadata, **BLANK})))


def load_codebook(path: str | Path) -> Codebook:
    """Read a file of `Codebook.save`; ModelError for a missing or damaged file, or one of another program."""
    require_package('safetensors', path)
    import safetensors  # noqa: PLC0415
    from safetensors.numpy import load  # noqa: PLC0415

    content, metadata = read_safetensors(path)
    try:
        centres = load(content)['centres'] if 'offradar.rad_vlad' in metadata else None
    except (safetensors.SafetensorError, TypeError, KeyError, ValueError) as error:
        raise ModelError(f'{path}: not a readable safetensors file ({first_line(error)})') from error
    if centres is None:
        raise ModelError(f'{path}: not the centres of rad_vlad: its metadata has no offradar.rad_vlad')
    try:
        settings = parse_json(metadata['offradar.rad_vlad'])
        typical = settings.pop('typical_repetition')
        codebook = Codebook(
            structure(RowSettings, settings), centres, typical, metadata.get('offradar.description', '')
        )
        found = codebook.fingerprint
        if not (isinstance(typical, float) and typical >= MIN_REPETITION and np.isfinite(typical)):
            raise ValueError(f'typical_repetition: expected a number of {MIN_REPETITION} or more, got {typical!r}')
    except (ValueError, TypeError, AttributeError, KeyError, ConfigError) as error:
        raise ModelError(f'{path}: offradar.rad_vlad holds no settings of rad_vlad ({first_line(error)})') from error
    if found != metadata.get('offradar.fingerprint'):
        raise ModelError(f'{path}: damaged or altered: its centres are not those of its fingerprint')
    if centres.ndim != 2 or centres.shape[1] != codebook.rows.features or centres.dtype != np.float32:
        raise ModelError(
            f'{path}: expected float32 centres of {codebook.rows.features} values, got {centres.dtype} {centres.shape}'
        )
    if not np.isfinite(centres).all():
        raise ModelError(f'{path}: its centres are not finite')
    return codebook
