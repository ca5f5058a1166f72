"""What is compared: encoders by the names that results use."""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.model_files import require_package
from offradar_ros.encoders.pretrained import find_weights
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.rad_vlad import RadVladEncoder
from offradar_ros.encoders.rad_vlad_codebook import load_codebook
from offradar_ros.encoders.rad_vlad_fit import fit_rad_vlad
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError, DataError, RefusedInput
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.recordings.spacing import subsample_by_distance
from offradar_ros.types import PolarScan

METHODS = ('ours', 'bc_radar', 'vae', 'mc_dropout', 'stun', 'ring_key', 'rad_vlad')
"""Those that a model card tells of."""

OURS = 'ours'
_ENCODERS = {name: name for name in METHODS} | {OURS: 'variational'}
PLAIN = EncoderConfig()
BEST = 'best.safetensors'
"""The weights that a training run leaves in its folder."""

_ROWS = 20_000
"""So many azimuths of a map are enough to fit the centres of RadVLAD."""


class Method(Protocol):
    """A name and the encoder to use with a map."""

    name: str
    weights: str
    fitted: bool
    """Whether each map has an encoder of its own."""

    def encoder_for(self, mapped: Drive) -> Encoder:
        """The encoder for the map made of this drive, and for what searches it."""


class OneEncoder:
    """The same encoder for every map."""

    fitted = False

    def __init__(self, name: str, encoder: Encoder, weights: str = '') -> None:
        self.name, self.weights, self._encoder = name, weights, encoder

    def encoder_for(self, mapped: Drive) -> Encoder:
        """As in `Method`."""
        del mapped
        return self._encoder


class RadVladOfMap:
    """RadVLAD as its authors use it: centres fitted to the scans of the map, kept in `folder`."""

    name, weights, fitted = 'rad_vlad', '', True

    def __init__(self, folder: Path, seed: int, spacing_m: float) -> None:
        self._folder, self._seed, self._spacing_m = folder, seed, spacing_m

    def encoder_for(self, mapped: Drive) -> Encoder:
        """As in `Method`."""
        path = self._folder / f'{mapped.key}_{self._seed}_{self._spacing_m:g}.safetensors'
        if not path.is_file():
            rows = subsample_by_distance(mapped.driven_m, self._spacing_m)
            per_scan = int(np.clip(_ROWS // len(rows), 1, 100))
            try:
                fitted = fit_rad_vlad(_readable(mapped, rows.tolist()), self._seed, rows_per_scan=per_scan)
            except DataError as error:
                raise DataError(f'{mapped.name}: RadVLAD cannot be fitted to it: {error}') from None
            self._folder.mkdir(parents=True, exist_ok=True)
            fitted.save(path)
        return RadVladEncoder(load_codebook(path))


def _readable(drive: Drive, rows: Iterable[int]) -> Iterator[PolarScan]:
    for row in rows:
        with contextlib.suppress(RefusedInput):
            yield drive.scan(row)


def open_method(
    text: str, folder: Path, *, seed: int, spacing_m: float, config: EncoderConfig = PLAIN, threads: int = 0
) -> Method:
    """The method of ``NAME``, ``NAME=WEIGHTS`` or ``NAME=RUN``, the folder of a training run.

    Any other name than those of `METHODS` is a variant's, of the kind that its safetensors file says. `folder` keeps
    what is fitted to maps; of `config` the method and the weights are left aside. ConfigError for a name that needs
    weights without them; ModelError for unusable weights.
    """
    name, _, weights = text.partition('=')
    if name == 'rad_vlad' and not weights:
        return RadVladOfMap(folder / 'rad_vlad', seed, spacing_m)
    if name == 'ring_key' and weights:
        raise ConfigError(f'--method {text}: ring_key has no weights')
    if not name or (name != 'ring_key' and not weights):
        meant = difflib.get_close_matches(name, METHODS, 1)
        hint = f'; did you mean {meant[0]}?' if meant and meant[0] != name else ', such as ours=compact'
        raise ConfigError(f'--method {text}: expected NAME=WEIGHTS{hint} (only ring_key and rad_vlad need no weights)')
    if weights and Path(weights).is_dir():
        weights = str(Path(weights) / BEST)
    elif weights and name != 'rad_vlad':
        weights = str(find_weights(weights, ('.safetensors', '.onnx')))
    encoder = _ENCODERS.get(name) or _kind_of(weights)
    return OneEncoder(
        name, make_encoder(dataclasses.replace(config, name=encoder, weights=weights, threads=threads)), weights
    )


def _kind_of(weights: str) -> str:
    """Name of the encoder that a weights file is of."""
    if weights.endswith('.onnx'):
        require_package('onnxruntime', weights)
        from offradar_ros.encoders.onnx_backend import OnnxEncoder  # noqa: PLC0415

        return OnnxEncoder(weights).info.name
    require_package('safetensors', weights)
    from offradar_ros.encoders.weights import read_header  # noqa: PLC0415

    return read_header(weights).config.method
