"""The methods that an evaluation compares: encoders under the names that results use."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.entry_points import installed_names
from offradar_ros.encoders.learned import choose_runtime
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.encoders.rad_vlad import RadVladEncoder
from offradar_ros.encoders.rad_vlad_codebook import load_codebook
from offradar_ros.encoders.rad_vlad_fit import fit_rad_vlad
from offradar_ros.encoders.registry import ENCODERS, LEARNED, make_encoder, unknown_name
from offradar_ros.errors import ConfigError, DataError, RefusedInput
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.recordings.spacing import subsample_by_distance
from offradar_ros.types import PolarScan

OURS = 'ours'
_OUR_ENCODER = 'variational'
METHODS = {OURS if name == _OUR_ENCODER else name: name for name in ENCODERS}
"""Encoders by the names that results use; ours first, the others in the order of the paper's tables."""

PLAIN = EncoderConfig()
BEST = 'best.safetensors'
"""The weights that a training run leaves in its folder."""

BATCHED_FIRST = ('torch', 'onnx', 'opencv')
"""Backends in the order that an evaluation prefers: torch encodes batches fastest."""

_ROWS = 20_000
"""Number of azimuths that the centres of RadVLAD are fitted to."""


class Method(Protocol):
    """An encoder under a name; the encoder may depend on the map."""

    name: str
    weights: str
    """File of the weights; empty for none."""
    fitted: bool
    """Whether the encoder is fitted to each map."""

    def encoder_for(self, mapped: Drive) -> Encoder:
        """The encoder of the map that is made of this drive, and of the queries that search it."""


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
    """RadVLAD as its authors use it: its centres are fitted to the scans of the map, and kept in `folder`."""

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
    """The method of ``NAME``, ``NAME=WEIGHTS`` or, for a variant, ``LABEL=NAME:WEIGHTS``.

    NAME is one of `METHODS`, or the entry point of an installed encoder; WEIGHTS may be the folder of a training run.
    Results use LABEL, or else NAME.

    Args:
        text: as given to ``--method``.
        folder: keeps what is fitted to maps.
        seed: of fits to maps.
        spacing_m: of the scans that RadVLAD is fitted to.
        config: settings of the encoder, without its name and weights.
        threads: of a learned encoder; 0 for one per core.

    ConfigError for an unknown NAME, missing or needless weights; ModelError for unusable weights.
    """
    label, encoder, weights = _parsed(text)
    if encoder == 'rad_vlad' and not weights:
        return RadVladOfMap(folder / 'rad_vlad', seed, spacing_m)
    config = dataclasses.replace(config, name=encoder, weights=weights, threads=threads)
    if encoder in LEARNED:
        weights = str(Path(weights) / BEST if Path(weights).is_dir() else choose_runtime(config, BATCHED_FIRST)[1])
        config = dataclasses.replace(config, weights=weights)
    return OneEncoder(label, make_encoder(config), weights)


def _parsed(text: str) -> tuple[str, str, str]:
    """Label, encoder and weights (empty for none) of a ``--method``; ConfigError if they do not fit each other."""
    known = METHODS | {name: name for name in installed_names()}
    label, _, weights = text.partition('=')
    encoder, colon, rest = weights.partition(':')
    if colon and encoder in known:
        if not label or label in known:
            raise ConfigError(f'--method {text}: expected a label that is not the name of an encoder, got {label!r}')
        name, weights = encoder, rest
    elif label in known:
        name = label
    else:
        raise ConfigError(f'--method {text}: {unknown_name(label, known)} (a variant is LABEL=NAME:WEIGHTS)')
    if name == 'ring_key' and weights:
        raise ConfigError(f'--method {text}: ring_key has no weights')
    if name != 'rad_vlad' and not weights and name in METHODS and ENCODERS[METHODS[name]].needs_weights:
        raise ConfigError(f'--method {text}: {name} needs weights: expected {name}=WEIGHTS, such as ours=compact')
    return label, METHODS.get(name, name), weights
