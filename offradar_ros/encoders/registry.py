"""Every encoder by name: one table, which configuration, networks, training, evaluation and reports read.

What an entry names is imported when it is used, so that a node loads no runtime but its own. `docs/encoders.md` says
how to add an encoder, here or in a package of one's own.
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
    """An encoder of ours. Each ``module:attribute`` is imported when it is used.

    Attributes:
        title: what tables and figures call it.
        factory: called with an `EncoderConfig`, gives the `Encoder`.
        network: class of a learned method, called with a `NetworkConfig`; a `Network` in torch.
        objective: what trains it, called with a `TrainingConfig` (and the teacher's network, where there is one).
        teacher: name of the method whose trained network it learns from.
        needs_weights: whether it cannot be made without the parameter `encoder.weights`.
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

    ConfigError for an unknown name and for settings that do not fit, ModelError for unusable weights.
    """
    if config.name in ENCODERS:
        encoder: Encoder = pkgutil.resolve_name(ENCODERS[config.name].factory)(config)
        return encoder
    installed = installed_names()
    if config.name in installed:
        return make_installed(config)
    raise ConfigError(f'parameter encoder.name: {unknown_name(config.name, (*ENCODERS, *installed))}')


def unknown_name(name: str, known: Iterable[str]) -> str:
    """What to say of a name that is none of `known`: the nearest, where one is near, and all of them."""
    known = list(known)
    nearest = difflib.get_close_matches(name, known, 1)
    hint = f'; did you mean {nearest[0]}?' if nearest else ''
    return f'expected one of {", ".join(known)}, got {name!r}{hint}'
