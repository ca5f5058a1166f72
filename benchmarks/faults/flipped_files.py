"""Damaged files of every form that the package reads: each is refused, or read as if it were sound."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from sample_signatures import packed_signature

import offradar_ros
from faults.child_batches import run_in_children
from faults.content_digest import content_digest
from faults.result import DIFFERENT, SAME, Result, Settings, Verdict, summed
from offradar_ros.config import (
    Config,
    EncoderConfig,
    MapConfig,
    is_node_parameter,
    load_config,
    parameters,
    read_parameters,
    write_parameters,
)
from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.geometry import GeoPoint
from offradar_ros.mapping.sessions import SessionMap
from offradar_ros.mapping.signature_file import SignatureFile
from offradar_ros.mapping.store import MapStore
from offradar_ros.recordings.bags.sequence import BagSequence
from offradar_ros.recordings.bags.writer import write_bag
from offradar_ros.types import Embedding, Pose

NAME = 'flips'
FULL = 500
PROJECT = Path(__file__).resolve().parents[2]
WEIGHTS = Path(offradar_ros.__file__).parent / 'weights'
DIMENSION = 64

Read = Callable[[Path], str]
"""A digest of all that the package takes from a file."""


def run(settings: Settings) -> list[Result]:
    """Damage copies of each form of file."""
    cv2.setNumThreads(1)
    forms = {
        'map': (small_map(settings.folder / 'sound.db'), read_map),
        'ONNX file': (WEIGHTS / 'compact.onnx', read_network('onnx')),
        'ONNX file, read by OpenCV': (WEIGHTS / 'compact.onnx', read_network('opencv')),
        'safetensors file': (WEIGHTS / 'compact.safetensors', read_network('torch')),
        'bag': (small_bag(settings.folder / 'sound_bag'), read_bag),
        'parameter file': (small_parameters(settings.folder / 'sound.yaml'), read_parameter_file),
    }
    return [flip(settings, form, path, read, number) for number, (form, (path, read)) in enumerate(forms.items())]


def flip(settings: Settings, form: str, sound: Path, read: Read, number: int) -> Result:
    """Tries of one form: its file with one bit flipped, a block zeroed, or its end missing."""
    started_s = time.monotonic()
    file = next(sound.glob('*.mcap')) if sound.is_dir() else sound
    content, expected = file.read_bytes(), read(sound)

    def attempt(index: int) -> Verdict:
        rng = np.random.default_rng([settings.seed, number, index])
        place = settings.folder / f'{number}_{index}'
        place.mkdir()
        try:
            copy = place / sound.name
            if sound.is_dir():
                shutil.copytree(sound, copy)
            damaged, what = damage(content, rng)
            (copy / file.name if sound.is_dir() else copy).write_bytes(damaged)
            found = read(copy)
            return Verdict(SAME) if found == expected else Verdict(DIFFERENT, what)
        finally:
            shutil.rmtree(place)

    verdicts = run_in_children(settings.tries(FULL), attempt)
    return summed(NAME, f'damaged {form}', verdicts, time.monotonic() - started_s)


def damage(content: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    """A damaged copy, and what was done: one bit of most, else a zeroed block, bytes exchanged, or a missing end."""
    damaged = bytearray(content)
    at = int(rng.integers(len(content)))
    kind = rng.choice(['bit', 'zeroes', 'exchanged', 'cut'], p=[0.7, 0.1, 0.1, 0.1])
    if kind == 'bit':
        damaged[at] ^= 1 << int(rng.integers(8))
    elif kind == 'zeroes':
        length = int(rng.integers(1, 513))
        damaged[at : at + length] = bytes(len(damaged[at : at + length]))
    elif kind == 'exchanged':
        other, length = int(rng.integers(len(content))), int(rng.integers(1, 65))
        first, second = damaged[at : at + length], damaged[other : other + length]
        if len(first) == len(second) and abs(at - other) >= length:
            damaged[at : at + length], damaged[other : other + length] = second, first
    else:
        del damaged[at:]
    return bytes(damaged), f'{kind} at byte {at} of {len(content)}'


def small_map(path: Path) -> Path:
    """A map of two ended sessions, the second of which can be undone, and one that was saved but not ended."""
    info = ModelInfo('ring_key', 'ab' * 32, DIMENSION, {})
    rng = np.random.default_rng(0)
    with SessionMap(MapConfig(path=str(path))) as session_map:
        session_map.adopt_model(info)
        session_map.set_origin(GeoPoint(51.75, -1.25, 70.0))
        for session in range(3):
            session_map.start_session(f'drive {session}', session)
            for k in range(30):
                mean = rng.standard_normal(DIMENSION).astype(np.float32)
                variance = rng.uniform(0.5, 1.5, DIMENSION).astype(np.float32)
                signature = packed_signature(100 * session + k, 20 + 2 * k, 20)
                embedding = Embedding(100 * session + k, mean, variance, info.fingerprint, signature)
                session_map.merge(embedding, Pose(12.0 * k + 30.0 * session, 1.0 * session, 0.0))
            session_map.save() if session == 2 else session_map.end_session()
    return path


def read_map(path: Path) -> str:
    """The map as a reader sees it, and as a map server does."""
    stored = MapStore.open_read_only(path)
    as_read = content_digest(
        stored.model,
        stored.origin,
        stored.next_place_id,
        stored.places,
        stored.anchors_m,
        stored.sessions,
        stored.before,
        stored.committed(),
        stored.signatures,
        SignatureFile(path).read(list(stored.signatures)),
    )
    with SessionMap(MapConfig(path=str(path))) as session_map:
        signatures = session_map.signatures.read(list(stored.signatures))
        return as_read + content_digest(session_map.model, session_map.origin, session_map.places(), signatures)


def small_bag(folder: Path) -> Path:
    """Scans of the recording that ships, as this version writes a bag."""
    return write_bag(BagSequence(PROJECT / 'bags' / 'session_1'), folder)


def read_bag(path: Path) -> str:
    """Every scan and position."""
    sequence = BagSequence(path)
    scans = [sequence.scan(index) for index in range(len(sequence))]
    trajectory = sequence.trajectory
    positions = (trajectory.stamps_ns, trajectory.positions, trajectory.yaws_rad) if trajectory else None
    return content_digest(sequence.stamps_ns, scans, positions)


def read_network(backend: str) -> Read:
    """Reader of weights by one runtime: the identity of the model, and what it makes of a scan."""
    scan = BagSequence(PROJECT / 'bags' / 'session_1').scan(0)

    def read(path: Path) -> str:
        encoder = make_encoder(EncoderConfig(name='variational', weights=str(path), backend=backend, threads=1))
        embedding = encoder.encode(scan)
        # The name of the file is not part of it.
        metadata = {key: value for key, value in encoder.info.metadata.items() if key != 'file'}
        info = encoder.info
        return content_digest(info.name, info.fingerprint, info.dimension, metadata, embedding.mean, embedding.variance)

    return read


def small_parameters(path: Path) -> Path:
    """A parameter file as `offradar calibrate` writes it."""
    values = {leaf.name: leaf.value for leaf in parameters(Config())}
    write_parameters(path, values, 'calibrated on a drive', with_digest=True)
    return path


def read_parameter_file(path: Path) -> str:
    """The configuration, and the parameters of nodes beside it."""
    values = read_parameters(path)
    return content_digest(load_config(path), {key: value for key, value in values.items() if is_node_parameter(key)})
