"""Encoders of other packages, valid and invalid ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest
from own_packages import write_package

from offradar_ros.config import EncoderConfig
from offradar_ros.encoders.registry import make_encoder
from offradar_ros.errors import ConfigError, ModelError, OffradarError


def test_a_factory_gets_the_configuration_without_our_default_weights(package: Callable[..., None]) -> None:
    package('echo', 'from offradar_ros.encoders.ring_key import RingKeyEncoder\n'
            'def make(config):\n    encoder = RingKeyEncoder(config.ring_key)\n    encoder.given = config\n'
            '    return encoder\n')  # fmt: skip
    config = EncoderConfig(name='echo', weights='a file', threads=3, device='cuda')
    assert make_encoder(config).given == config  # type: ignore[attr-defined]
    given = make_encoder(EncoderConfig(name='echo')).given  # type: ignore[attr-defined]
    assert given == dataclasses.replace(EncoderConfig(name='echo'), weights='')


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Installs a package that offers one encoder, `module:make`."""

    def install(name: str, source: str, module: str | None = None) -> None:
        write_package(
            tmp_path / 'site', module or f'{name}_module', {name: f'{module or f"{name}_module"}:make'}, source
        )

    (tmp_path / 'site').mkdir()
    monkeypatch.syspath_prepend(str(tmp_path / 'site'))
    return install


@pytest.mark.parametrize(
    'name, source, error, expected',
    [
        ('absent', 'import nothing_of_this_name\n', ModelError, "ModuleNotFoundError: No module named 'nothing_of"),
        ('nameless', 'other = 1\n', ModelError, 'AttributeError: '),
        ('raising', 'def make(config):\n    raise ValueError("no\\nweights")\n', ModelError, 'ValueError: no'),
        (
            'wrong',
            'def make(config):\n    return 3\n',
            ConfigError,
            'expected an Encoder (info, runs_on, encode), got int',
        ),
    ],
)
def test_an_error_of_a_package_is_one_line_with_its_name(
    package: Callable[..., None], name: str, source: str, error: type[OffradarError], expected: str
) -> None:
    package(name, source)
    with pytest.raises(error) as refused:
        make_encoder(EncoderConfig(name=name))
    message = str(refused.value)
    assert message.startswith(f'encoder {name} of the package {name}_module ({name}_module:make): ')
    assert expected in message
    assert '\n' not in message


def test_an_offradar_error_passes_through(package: Callable[..., None]) -> None:
    package(
        'strict', 'from offradar_ros.errors import ModelError\ndef make(config):\n    raise ModelError("x: no file")\n'
    )
    with pytest.raises(ModelError, match=r'^x: no file$'):
        make_encoder(EncoderConfig(name='strict'))


def test_a_name_that_two_packages_offer_is_refused(package: Callable[..., None]) -> None:
    package('both', 'make = None\n', 'first')
    package('both', 'make = None\n', 'second')
    with pytest.raises(ConfigError, match='both is offered by first and second: uninstall one'):
        make_encoder(EncoderConfig(name='both'))


def test_an_unknown_name_is_compared_with_all_encoders(own_encoder: str) -> None:
    with pytest.raises(ConfigError) as refused:
        make_encoder(EncoderConfig(name='median_ring'))
    message = str(refused.value)
    assert message.startswith('parameter encoder.name: expected one of variational, bc_radar, ')
    assert message.endswith("median_rings, got 'median_ring'; did you mean median_rings?")
