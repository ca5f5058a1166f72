"""Training configurations: presets, valid and invalid values, and learning rates."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offradar_ros.encoders.registry import LEARNED
from offradar_ros.errors import ConfigError
from offradar_ros.lab.training.config import OptimiserConfig, TrainingConfig
from offradar_ros.lab.training.config_file import read_config, with_values
from offradar_ros.lab.training.schedule import learning_rate
from offradar_ros.records import write_record

PRESETS = Path(__file__).resolve().parents[3] / 'params' / 'train'


@pytest.mark.parametrize('path', sorted(PRESETS.glob('*.yaml')), ids=lambda path: path.stem)
def test_every_preset_is_read(path: Path) -> None:
    assert isinstance(read_config(path), TrainingConfig)


def test_every_learned_method_has_a_preset() -> None:
    presets = [read_config(path) for path in PRESETS.glob('*.yaml')]
    assert {config.method for config in presets if config.fit == 'network'} == set(LEARNED)


def test_the_preset_paper_has_the_settings_of_the_paper() -> None:
    config = read_config(PRESETS / 'paper.yaml')
    assert (config.network.backbone, config.network.side_px, config.network.resolution_m) == ('vgg16', 256, 0.5)
    assert (config.network.dimension, config.batch.places, config.optimiser.learning_rate) == (128, 8, 1e-5)
    for term in (config.loss.invariant, config.loss.variant):
        assert (term.criterion, term.temperature, term.negative_weight) == ('batch', 1.0, 0.1)
    assert (config.loss.invariant.on, config.loss.variant.on) == ('z_i', 'z')
    assert config.batch.positive == 'time'


def test_what_is_written_is_read_as_it_was(tmp_path: Path) -> None:
    for path in PRESETS.glob('*.yaml'):
        config = read_config(path, ['data.sequences=[a, b]'])
        write_record(tmp_path / 'again.yaml', config)
        assert read_config(tmp_path / 'again.yaml') == config


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('stepps: 3', 'key stepps is unknown: did you mean steps?'),
        ('loss: {variant: {tau: 1.0}}', 'key loss.variant.tau is unknown'),
        ('steps: 1.5', 'key steps: expected a whole number, got 1.5'),
        ('steps: true', 'key steps: expected a whole number, got True'),
        ('steps: 0', 'key steps: expected at least 1, got 0'),
        ('batch: {spin: 1}', 'key batch.spin: expected true or false, got 1'),
        ('batch: {positive: far}', "key batch.positive: expected one of place, time, got 'far'"),
        ('optimiser: {learning_rate: .nan}', 'key optimiser.learning_rate: expected a finite number'),
        ('optimiser: {learning_rate: fast}', "key optimiser.learning_rate: expected a finite number, got 'fast'"),
        ('network: {side_px: 100}', 'network setting side_px: expected a multiple of 32'),
        ('network: {method: bert}', 'network setting method: expected one of variational'),
        ('loss: 3', 'key loss is unknown'),
        ('data: {sequences: here}', 'key data.sequences: expected a list, got'),
        ('- 1', 'expected a mapping of keys, got list'),
        ('a: [', 'not a readable YAML file'),
    ],
)
def test_an_invalid_value_is_an_error_of_one_line_with_file_and_key(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_config(path)
    assert str(caught.value).startswith(f'{path}: ')
    assert message in str(caught.value)
    assert '\n' not in str(caught.value)


def test_settings_change_keys(tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text('steps: 7')
    config = read_config(path, ['optimiser.learning_rate=1e-5', 'batch.spin=false', 'network.method=vae'])
    assert (config.steps, config.optimiser.learning_rate, config.batch.spin, config.method) == (7, 1e-5, False, 'vae')
    for wrong in ('steps', '=3', 'steps=x', 'steps=['):
        with pytest.raises(ConfigError, match=r'--set'):
            read_config(path, [wrong])
    with pytest.raises(ConfigError, match='no such file'):
        read_config(tmp_path / 'none.yaml')


@settings(max_examples=60, deadline=None)
@given(
    st.dictionaries(
        st.sampled_from(['steps', 'loss.kl_weight', 'data.sequences', 'network.backbone', 'batch.spin', 'x']),
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.lists(st.integers()),
    )
)
def test_any_value_is_accepted_or_refused_in_one_line(values: dict[str, object]) -> None:
    try:
        config = with_values(TrainingConfig(), values, 'mine.yaml')
    except ConfigError as error:
        assert str(error).startswith('mine.yaml: ')
    else:
        for key, value in values.items():
            found: object = config
            for name in key.split('.'):
                found = getattr(found, name)
            assert found == (tuple(value) if isinstance(value, list) else value) or str(value) == str(found)


def test_schedules_increase_and_decrease() -> None:
    rates = {
        name: [learning_rate(OptimiserConfig(learning_rate=2.0, schedule=name, warmup=0.2), s, 100) for s in range(100)]
        for name in ('constant', 'cosine', 'one_cycle')
    }
    assert set(rates['constant']) == {2.0}
    assert rates['cosine'] == sorted(rates['cosine'], reverse=True)
    assert rates['cosine'][0] == 2.0
    assert rates['cosine'][50] == pytest.approx(1.0)
    assert max(rates['one_cycle']) == rates['one_cycle'][20] == 2.0
    assert rates['one_cycle'][:21] == sorted(rates['one_cycle'][:21])
    assert rates['one_cycle'][20:] == sorted(rates['one_cycle'][20:], reverse=True)
    assert rates['one_cycle'][-1] < 0.01
    flat = dataclasses.replace(OptimiserConfig(learning_rate=1.0, schedule='one_cycle'), warmup=0.0)
    assert learning_rate(flat, 0, 1) == 1.0
