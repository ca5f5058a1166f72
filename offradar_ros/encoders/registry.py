"""All encoders by name: the table for configuration, networks, training, evaluation and reports.

The objects of an entry are imported when they are used, so that a node loads only its own runtime. `docs/encoders.md`
says how to add an encoder, here or in another package.
"""

from __future__ import annotations

import dataclasses
import difflib
import pkgutil
from collections.abc import Iterable

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.entry_points import installed_names, make_installed
from offradar_ros.encoders.protocol import Encoder
from offradar_ros.errors import ConfigError

LEARNED_FACTORY = 'offradar_ros.encoders.learned:make_learned'


@dataclasses.dataclass(frozen=True)
class EncoderEntry:
    """An encoder of this package. Each ``module:attribute`` is imported when it is used.

    Attributes:
        title: name in tables and figures.
        factory: function of an `EncoderConfig` that returns the `Encoder`.
        network: class of a learned method's network, a torch `Network`; called with a `NetworkConfig`.
        objective: class of its training objective; called with a `TrainingConfig` and, if it has a teacher, the
            teacher's network.
        teacher: name of the method whose trained network is its teacher.
        needs_weights: whether it needs the parameter `encoder.weights`.
    """

    title: str
    factory: str = LEARNED_FACTORY
    network: str = ''
    objective: str = ''
    teacher: str = ''
    needs_weights: bool = True


_NETWORKS = 'offradar_ros.encoders.networks'
_TRAINING = 'offradar_ros.lab.training'
_CONTRASTIVE = f'{_TRAINING}.baselines.contrastive_objective:ContrastiveObjective'

ENCODERS: dict[str, EncoderEntry] = {
    'variational': EncoderEntry(
        'OURS',
        network=f'{_NETWORKS}.variational:VariationalNetwork',
        objective=f'{_TRAINING}.variational_objective:VariationalObjective',
    ),
    'bc_radar': EncoderEntry('BCRadar', network=f'{_NETWORKS}.bc_radar:BcRadarNetwork', objective=_CONTRASTIVE),
    'vae': EncoderEntry(
        'VAE', network=f'{_NETWORKS}.vae:VaeNetwork', objective=f'{_TRAINING}.baselines.vae_objective:VaeObjective'
    ),
    'mc_dropout': EncoderEntry(
        'MC Dropout', network=f'{_NETWORKS}.mc_dropout:McDropoutNetwork', objective=_CONTRASTIVE
    ),
    'stun': EncoderEntry(
        'STUN',
        network=f'{_NETWORKS}.stun:StunNetwork',
        objective=f'{_TRAINING}.baselines.stun_objective:StunObjective',
        teacher='bc_radar',
    ),
    'ring_key': EncoderEntry(
        'RingKey', 'offradar_ros.encoders.ring_key:RingKeyEncoder.from_config', needs_weights=False
    ),
    'rad_vlad': EncoderEntry('FFT-RadVLAD', 'offradar_ros.encoders.rad_vlad:RadVladEncoder.from_config'),
}
"""In the order of the paper's tables."""

LEARNED = tuple(name for name, entry in ENCODERS.items() if entry.network)
"""Names of the learned methods."""


def make_encoder(config: EncoderConfig) -> Encoder:
    """The encoder that `config` names, one of `ENCODERS` or of an installed package (see `entry_points`).

    ConfigError for an unknown name and for settings that do not match, ModelError for invalid weights.
    """
    if config.name in ENCODERS:
        encoder: Encoder = pkgutil.resolve_name(ENCODERS[config.name].factory)(config)
        return encoder
    installed = installed_names()
    if config.name in installed:
        return make_installed(config)
    raise ConfigError(f'parameter encoder.name: {unknown_name(config.name, (*ENCODERS, *installed))}')


def unknown_name(name: str, known: Iterable[str]) -> str:
    """Error message for a name that is not in `known`: all known names, and the most similar one if there is any."""
    known = list(known)
    nearest = difflib.get_close_matches(name, known, 1)
    hint = f'; did you mean {nearest[0]}?' if nearest else ''
    return f'expected one of {", ".join(known)}, got {name!r}{hint}'
