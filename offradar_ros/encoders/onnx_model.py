"""An ONNX file that is read once and checked: the bytes that were checked are the bytes that a runtime gets."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from offradar_ros.encoders.model_files import read_model_file
from offradar_ros.encoders.onnx_digest import digest_is_right, has_digest
from offradar_ros.encoders.onnx_file import has_external_data, read_metadata
from offradar_ros.encoders.probe import Probe
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ConfigError, ModelError

PROBE = 'offradar.probe'
"""Metadata entry with what the network gives for the probe image."""


@dataclasses.dataclass(frozen=True, eq=False)
class OnnxModel:
    """The content of a checked file, its header, and what its network gives for the probe image."""

    content: bytes
    header: WeightsHeader
    probe: Probe


def read_onnx(path: str | Path) -> OnnxModel:
    """Read a file of `export_onnx` and check it, before any runtime sees it.

    ModelError for a file that is missing, damaged or altered, not ours, or without a digest, as an earlier version
    wrote it; and for one that refers to other files.
    """
    content = read_model_file(path)
    if has_digest(content) and not digest_is_right(content):
        raise ModelError(f'{path}: damaged or altered: its content is not that of its digest: copy or export it again')
    metadata, header = header_of(content, path)
    if not has_digest(content):
        raise ModelError(
            f'{path}: has no digest, so that damage cannot be seen: it is of an earlier version, or cut off: export '
            f'the weights again, or if you trust this file: offradar export {path} NEW.onnx'
        )
    try:
        return OnnxModel(content, header, Probe.from_text(metadata.get(PROBE, '')))
    except ConfigError as error:
        raise ModelError(f'{path}: {PROBE}: {error}') from error


def header_of(content: bytes, path: str | Path) -> tuple[dict[str, str], WeightsHeader]:
    """Metadata and header in the content of `path`; ModelError if it is not ONNX, not ours, or not all in one file."""
    try:
        metadata = read_metadata(content)
        is_whole = not has_external_data(content)
    except ValueError as error:
        raise ModelError(f'{path}: not a readable ONNX file ({error})') from error
    if not is_whole:
        raise ModelError(f'{path}: refers to tensors in other files: expected one file, as offradar export writes it')
    return metadata, WeightsHeader.from_metadata(metadata, path)
