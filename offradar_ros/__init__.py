"""Radar place recognition that knows when it does not know.

The stable names of the package are exported here (docs/python_api.md). The module of a name is imported at the name's
first use, so that `import offradar_ros` loads nothing, and a node loads only what it needs.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from offradar_ros.config import Config as Config
    from offradar_ros.config import EncoderConfig as EncoderConfig
    from offradar_ros.config import LocalisationConfig as LocalisationConfig
    from offradar_ros.config import MapConfig as MapConfig
    from offradar_ros.config import QueryConfig as QueryConfig
    from offradar_ros.config import RadarConfig as RadarConfig
    from offradar_ros.config import load_config as load_config
    from offradar_ros.encoders.protocol import Encoder as Encoder
    from offradar_ros.encoders.protocol import ModelInfo as ModelInfo
    from offradar_ros.encoders.registry import make_encoder as make_encoder
    from offradar_ros.errors import ConfigError as ConfigError
    from offradar_ros.errors import DataError as DataError
    from offradar_ros.errors import MapError as MapError
    from offradar_ros.errors import ModelError as ModelError
    from offradar_ros.errors import OffradarError as OffradarError
    from offradar_ros.errors import RefusedInput as RefusedInput
    from offradar_ros.mapping.sessions import SessionMap as SessionMap
    from offradar_ros.radar.png import decode_png as decode_png
    from offradar_ros.recordings.source import open_source as open_source
    from offradar_ros.sequence import RadarSequence as RadarSequence
    from offradar_ros.stages.query import QueryStage as QueryStage
    from offradar_ros.types import Candidate as Candidate
    from offradar_ros.types import Embedding as Embedding
    from offradar_ros.types import Localisation as Localisation
    from offradar_ros.types import LocalisationState as LocalisationState
    from offradar_ros.types import Match as Match
    from offradar_ros.types import Outcome as Outcome
    from offradar_ros.types import Place as Place
    from offradar_ros.types import PlaceTable as PlaceTable
    from offradar_ros.types import PolarScan as PolarScan
    from offradar_ros.types import Pose as Pose
    from offradar_ros.types import Reason as Reason
    from offradar_ros.types import Rejection as Rejection

EXPORTS = {
    'config': (
        'Config',
        'EncoderConfig',
        'LocalisationConfig',
        'MapConfig',
        'QueryConfig',
        'RadarConfig',
        'load_config',
    ),
    'encoders.protocol': ('Encoder', 'ModelInfo'),
    'encoders.registry': ('make_encoder',),
    'errors': ('ConfigError', 'DataError', 'MapError', 'ModelError', 'OffradarError', 'RefusedInput'),
    'mapping.sessions': ('SessionMap',),
    'radar.png': ('decode_png',),
    'recordings.source': ('open_source',),
    'sequence': ('RadarSequence',),
    'stages.query': ('QueryStage',),
    'types': (
        'Candidate',
        'Embedding',
        'Localisation',
        'LocalisationState',
        'Match',
        'Outcome',
        'Place',
        'PlaceTable',
        'PolarScan',
        'Pose',
        'Reason',
        'Rejection',
    ),
}
"""The stable names, by module."""

__all__ = [name for names in EXPORTS.values() for name in names]
__version__: str

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """An export, or the version, looked up at first use."""
        if name == '__version__':
            found = _version()
        else:
            module = next((module for module, names in EXPORTS.items() if name in names), None)
            if module is None:
                raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
            found = getattr(importlib.import_module(f'{__name__}.{module}'), name)
        globals()[name] = found
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__, '__version__'})


def _version() -> str:
    """The version in package.xml, which a checkout has next to the package; else that of the installed package."""
    import importlib.metadata  # noqa: PLC0415
    from pathlib import Path  # noqa: PLC0415
    from xml.etree import ElementTree  # noqa: PLC0415

    manifest = Path(__file__).resolve().parent.parent / 'package.xml'
    if manifest.is_file():
        return ElementTree.parse(manifest).findtext('version', '')
    return importlib.metadata.version(__name__)
