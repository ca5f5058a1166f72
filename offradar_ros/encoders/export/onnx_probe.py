"""What an ONNX file gives for the probe image, and its digest, which earlier versions did not write.

A call needs onnxruntime.
"""

from __future__ import annotations

from pathlib import Path

from offradar_ros.encoders.model_files import first_line, read_model_file, require_package, write_atomically
from offradar_ros.encoders.onnx_digest import has_digest, with_digest
from offradar_ros.encoders.onnx_file import metadata_entry
from offradar_ros.encoders.onnx_model import PROBE, header_of
from offradar_ros.encoders.probe import Probe, probe_image, require_sound
from offradar_ros.encoders.weights_header import WeightsHeader
from offradar_ros.errors import ModelError


def probe_onnx(content: bytes, header: WeightsHeader, path: str | Path) -> Probe:
    """What ONNX Runtime computes with the content of `path`; ModelError if it cannot run it."""
    require_package('onnxruntime', path)
    import onnxruntime  # noqa: PLC0415

    try:
        session = onnxruntime.InferenceSession(content, providers=['CPUExecutionProvider'])
        mean, variance = session.run(['mean', 'variance'], {'images': probe_image(header.config)})
    except Exception as error:  # its exceptions have no common base class
        raise ModelError(f'{path}: ONNX Runtime cannot run it ({first_line(error)})') from error
    require_sound((mean, variance), header.config, path)
    return Probe.of(mean, variance)


def add_digest(path: str | Path, out: str | Path) -> WeightsHeader:
    """Copy an ONNX file of an earlier version, with a digest: what it holds now is taken as right.

    ModelError if it has a digest already, is not ours, refers to other files or cannot be run.
    """
    content = read_model_file(path)
    if has_digest(content):
        raise ModelError(f'{path}: has a digest already: nothing to export')
    _, header = header_of(content, path)
    probe = probe_onnx(content, header, path)
    write_atomically(out, with_digest(content + metadata_entry(PROBE, probe.to_text())))
    return header
