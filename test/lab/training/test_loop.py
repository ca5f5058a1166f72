"""The loop trains, logs, stops, and is resumed with the same result."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip('torch')

import torch
from safetensors.torch import load_file

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.files import load_network
from offradar_ros.errors import ModelError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.batches import BatchSampler
from offradar_ros.lab.training.checkpoint import read_progress
from offradar_ros.lab.training.config import (
    BatchConfig,
    ContrastConfig,
    DistillationConfig,
    LossConfig,
    OptimiserConfig,
    TrainingConfig,
    ValidationConfig,
)
from offradar_ros.lab.training.loop import BEST, CHECKPOINT, LAST, Loop
from offradar_ros.lab.training.objectives import make_objective
from offradar_ros.lab.training.parallel import Group
from offradar_ros.lab.training.run_log import read_log
from offradar_ros.lab.training.validation import validate, validation_drives

MakeDrive = Callable[..., Drive]

CONFIG = TrainingConfig(
    network=NetworkConfig(backbone='compact', dimension=16, azimuths=24, range_bins=16, resolution_m=4.0),
    validation=ValidationConfig(every_steps=5),
    batch=BatchConfig(places=5),
    loss=LossConfig(
        invariant=ContrastConfig(weight=0.0),
        variant=ContrastConfig(criterion='temperature', on='mean', temperature=0.1),
        kl_weight=0.001,
    ),
    optimiser=OptimiserConfig(learning_rate=3e-3, schedule='one_cycle'),
    steps=15,
    log_steps=3,
    checkpoint_steps=100,
    threads=1,
)


def two_drives(make_drive: MakeDrive, degraded: tuple[int, ...] = (2, 5), speckle: float = 8.0) -> list[Drive]:
    """Two drives past the same eight places; some scans of the second are degraded."""
    return [make_drive('a', speckle=speckle), make_drive('b', lane_m=5.0, degraded=degraded, speckle=speckle)]


@pytest.fixture
def make_loop(make_drive: MakeDrive, tmp_path: Path) -> Callable[..., Loop]:
    """A run on two drives of eight places, with the same drives for validation."""

    def make(
        name: str = 'run',
        config: TrainingConfig = CONFIG,
        resume: bool = False,
        degraded: tuple[int, ...] = (2, 5),
        speckle: float = 8.0,
        targets: NDArray[np.float16] | None = None,
    ) -> Loop:
        drives = two_drives(make_drive, degraded, speckle)
        out = tmp_path / name
        out.mkdir(exist_ok=True)
        torch.manual_seed(config.seed)
        return Loop(
            config,
            make_objective(config),
            BatchSampler(drives, config.batch, config.seed),
            validation_drives(drives, config.network, 1),
            out,
            Group(0, 1, torch.device('cpu')),
            resume,
            targets,
        )

    return make


def weights(folder: Path) -> dict[str, torch.Tensor]:
    return load_network(folder / LAST)[0].state_dict()


def equal(a: dict[str, torch.Tensor], b: dict[str, torch.Tensor]) -> bool:
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


class StopAfter:
    """Interrupts a run between steps."""

    def __init__(self, steps: int) -> None:
        self.left = steps

    def __call__(self) -> None:
        self.left -= 1
        if self.left <= 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize('criterion', ['temperature', 'batch'])
def test_a_few_places_are_recognised_after_training(
    make_loop: Callable[..., Loop], make_drive: MakeDrive, criterion: str
) -> None:
    variant = ContrastConfig(criterion=criterion, on='mean', temperature=0.1, negative_weight=1.0)
    validation = ValidationConfig(every_steps=60)
    config = dataclasses.replace(
        CONFIG,
        loss=dataclasses.replace(CONFIG.loss, variant=variant),
        batch=BatchConfig(places=8, spin=False),
        validation=validation,
        steps=60,
    )
    loop = make_loop(config=config, degraded=(), speckle=28.0)
    drives = validation_drives(two_drives(make_drive, (), 28.0), CONFIG.network, 1)
    before = validate(loop.objective.network.eval().embed, drives, validation, torch.device('cpu'))
    assert before['recall_at_1'] < 1.0
    assert loop.run()
    (after,) = read_log(loop.out / 'validation.jsonl')
    assert after['recall_at_1'] == 1.0
    assert after['score'] == 2.0
    log = read_log(loop.out / 'log.jsonl')
    assert log[-1]['loss'] < log[0]['loss']


@pytest.mark.parametrize(('optimiser', 'stop'), [('adam', 4), ('adamw', 6), ('muon', 5)])
def test_a_resumed_run_gives_the_same_result(make_loop: Callable[..., Loop], optimiser: str, stop: int) -> None:
    settings = dataclasses.replace(CONFIG.optimiser, name=optimiser, weight_decay=0.01)
    config = dataclasses.replace(CONFIG, optimiser=settings)
    whole = make_loop('whole', config)
    assert whole.run()
    with pytest.raises(KeyboardInterrupt):
        make_loop('parts', config).run(check=StopAfter(stop))
    parts = make_loop('parts', config, resume=True)
    assert parts.step == stop
    assert parts.run()
    assert equal(weights(whole.out), weights(parts.out))
    assert whole.best == parts.best
    for name in ('log', 'validation'):
        kept = [
            [{k: v for k, v in line.items() if k != 'images_per_s'} for line in read_log(run.out / f'{name}.jsonl')]
            for run in (whole, parts)
        ]
        at = {line['step']: line for line in kept[0]}
        # Means over the steps since the last line differ if the run was stopped between two lines.
        assert [line for line in kept[1] if line['step'] > stop + 3] == [at[s] for s in at if s > stop + 3]
        assert [line['step'] for line in kept[1]] == list(at)


@pytest.mark.parametrize(
    ('change', 'is_kept'),
    [({}, True), ({'every_steps': 9}, True), ({'recall_weight': 0.01}, False), ({'map_spacing_m': 10.0}, False)],
)
def test_a_best_score_counts_only_among_those_of_the_same_rule(
    make_loop: Callable[..., Loop], change: dict[str, float], is_kept: bool
) -> None:
    validation = ValidationConfig(every_steps=4)
    config = dataclasses.replace(CONFIG, validation=validation)
    with pytest.raises(KeyboardInterrupt):
        make_loop(config=config).run(check=StopAfter(5))
    changed = dataclasses.replace(config, validation=dataclasses.replace(validation, **change))  # type: ignore[arg-type]
    resumed = make_loop(config=changed, resume=True)
    assert (resumed.best[1] == 4) == is_kept
    assert resumed.run()
    lines = read_log(resumed.out / 'validation.jsonl')
    assert resumed.best[0] == max(line['score'] for line in lines if is_kept or line['step'] > 5)


ALL_KEYS = dataclasses.replace(
    CONFIG,
    batch=BatchConfig(places=5, chunk=4, gain_db=6.0, floor_db=10.0, knee_db=40.0),
    loss=dataclasses.replace(CONFIG.loss, variant=dataclasses.replace(CONFIG.loss.variant, on='z')),
    distillation=DistillationConfig('compact'),
    optimiser=dataclasses.replace(
        CONFIG.optimiser, name='adamw', weight_decay=0.01, average=0.9, frozen_groups=2, frozen_from=0.4
    ),
)
TARGETS = np.random.default_rng(6).normal(0.0, 0.5, (16, 2, 16)).astype(np.float16)
"""For the sixteen scans of both drives."""


@pytest.mark.parametrize('stop', [4, 8])
def test_a_run_with_every_key_is_resumed_with_the_same_result(make_loop: Callable[..., Loop], stop: int) -> None:
    """Chunks, changed receivers, distillation, averaged weights, and layers that freeze before or after the stop."""
    whole = make_loop('whole', ALL_KEYS, targets=TARGETS)
    assert whole.run()
    with pytest.raises(KeyboardInterrupt):
        make_loop('parts', ALL_KEYS, targets=TARGETS).run(check=StopAfter(stop))
    parts = make_loop('parts', ALL_KEYS, resume=True, targets=TARGETS)
    assert parts.run()
    assert equal(weights(whole.out), weights(parts.out))
    assert equal(load_file(whole.out / CHECKPOINT), load_file(parts.out / CHECKPOINT))
    assert whole.best == parts.best
    assert {'distilled_descriptor', 'distilled_variance', 'variant'} <= read_log(parts.out / 'log.jsonl')[-1].keys()


@pytest.mark.parametrize('key', ['chunk', 'average', 'frozen_groups', 'gain_db', 'distillation'])
def test_each_key_changes_the_result(make_loop: Callable[..., Loop], key: str) -> None:
    config = dataclasses.replace(CONFIG, steps=8)
    changed = {
        'chunk': dataclasses.replace(config, batch=dataclasses.replace(config.batch, chunk=4)),
        'gain_db': dataclasses.replace(config, batch=dataclasses.replace(config.batch, gain_db=6.0)),
        'average': dataclasses.replace(config, optimiser=dataclasses.replace(config.optimiser, average=0.9)),
        'frozen_groups': dataclasses.replace(config, optimiser=dataclasses.replace(config.optimiser, frozen_groups=1)),
        'distillation': config,
    }[key]
    plain, other = make_loop('plain', config), make_loop('other', changed, targets=_targets_if(key))
    plain.run()
    other.run()
    assert not equal(weights(plain.out), weights(other.out))


def _targets_if(key: str) -> NDArray[np.float16] | None:
    return TARGETS if key == 'distillation' else None


def test_averaged_weights_are_what_is_validated_and_saved(make_loop: Callable[..., Loop]) -> None:
    settings = dataclasses.replace(CONFIG.optimiser, average=0.9)
    loop = make_loop(config=dataclasses.replace(CONFIG, optimiser=settings))
    plain = make_loop('plain')
    loop.run()
    plain.run()
    trained, averaged = loop.objective.network.state_dict(), weights(loop.out)
    assert torch.equal(trained['mu.weight'], plain.objective.network.state_dict()['mu.weight'])
    assert not torch.equal(averaged['mu.weight'], trained['mu.weight'])
    (last,) = (line for line in read_log(loop.out / 'validation.jsonl') if line['step'] == 15)
    drives = loop._validation
    again = validate(load_network(loop.out / LAST)[0].embed, drives, CONFIG.validation, torch.device('cpu'))
    assert again['score'] == pytest.approx(last['score'])
    assert again['u_mean'] == pytest.approx(last['u_mean'])


def test_frozen_groups_stay_and_the_others_go_on(make_loop: Callable[..., Loop]) -> None:
    settings = dataclasses.replace(CONFIG.optimiser, frozen_groups=2, frozen_from=0.4)
    loop = make_loop(config=dataclasses.replace(CONFIG, optimiser=settings))
    groups = loop.objective.network.features.backbone.groups
    seen: list[list[torch.Tensor]] = []

    def look() -> None:
        seen.append([torch.cat([part.detach().flatten() for part in group.parameters()]) for group in groups])

    loop.run(check=look)
    # Checked after each of the 14 first steps; from step 6 on, of 15, the first two groups are frozen.
    for number in range(len(groups)):
        moved = [not torch.equal(before[number], after[number]) for before, after in itertools.pairwise(seen[:14])]
        assert moved == [number >= 2 or step < 6 for step in range(1, 14)], number


def test_steps_after_the_last_checkpoint_are_repeated(make_loop: Callable[..., Loop]) -> None:
    """As after a power cut: the log has more steps than the checkpoint."""
    config = dataclasses.replace(CONFIG, checkpoint_steps=5)
    whole = make_loop('whole', config)
    whole.run()
    cut = make_loop('cut', config)
    with pytest.raises(KeyboardInterrupt):
        cut.run(check=StopAfter(5))
    before = (cut.out / CHECKPOINT).read_bytes()
    with pytest.raises(KeyboardInterrupt):
        make_loop('cut', config, resume=True).run(check=StopAfter(6))
    (cut.out / CHECKPOINT).write_bytes(before)
    again = make_loop('cut', config, resume=True)
    assert again.step == 5
    again.run()
    assert equal(weights(whole.out), weights(again.out))
    assert [line['step'] for line in read_log(again.out / 'log.jsonl')] == [3, 6, 9, 12, 15]


def test_the_same_seed_gives_the_same_weights_and_another_seed_others(make_loop: Callable[..., Loop]) -> None:
    runs = [make_loop(str(i), dataclasses.replace(CONFIG, steps=4, seed=seed)) for i, seed in enumerate((1, 1, 2))]
    for loop in runs:
        loop.run()
    assert equal(weights(runs[0].out), weights(runs[1].out))
    assert not equal(weights(runs[0].out), weights(runs[2].out))


def test_the_best_weights_are_saved(make_loop: Callable[..., Loop], make_drive: MakeDrive) -> None:
    loop = make_loop()
    loop.run()
    validated = read_log(loop.out / 'validation.jsonl')
    assert [line['step'] for line in validated] == [5, 10, 15]
    best = max(validated, key=lambda line: line['score'])
    assert loop.best == (best['score'], best['step'])
    network, header = load_network(loop.out / BEST)
    assert header.description.startswith(f'step {best["step"]}: score {best["score"]:.3f}')
    drives = validation_drives(two_drives(make_drive), CONFIG.network, 1)
    again = validate(network.embed, drives, CONFIG.validation, torch.device('cpu'))
    assert again['score'] == pytest.approx(best['score'])


def test_a_run_that_reaches_its_time_limit_writes_a_checkpoint(make_loop: Callable[..., Loop]) -> None:
    loop = make_loop()
    assert not loop.run(deadline_s=time.monotonic())
    assert loop.step == 1
    assert read_progress(loop.out / CHECKPOINT).step == 1
    resumed = make_loop(resume=True)
    assert resumed.run()
    assert make_loop(resume=True).run()


@pytest.mark.parametrize(('precision', 'channels_last'), [('bf16', True), ('fp32', False)])
def test_other_precisions_and_memory_layouts_train(
    make_loop: Callable[..., Loop], precision: str, channels_last: bool
) -> None:
    loop = make_loop(config=dataclasses.replace(CONFIG, steps=3, precision=precision, channels_last=channels_last))
    assert loop.run()
    (line,) = read_log(loop.out / 'log.jsonl')
    assert math.isfinite(line['loss'])
    assert all(tensor.dtype == torch.float32 for tensor in loop.objective.network.parameters())


def test_a_loss_that_is_not_finite_stops_the_run(make_loop: Callable[..., Loop]) -> None:
    optimiser = OptimiserConfig(learning_rate=100.0, schedule='constant', clip_norm=0.0)
    loss = dataclasses.replace(CONFIG.loss, reconstruction_weight=1e9)
    loop = make_loop(config=dataclasses.replace(CONFIG, optimiser=optimiser, loss=loss, steps=200))
    with pytest.raises(ModelError, match=r'no longer finite at step \d+: expected a lower optimiser.learning_rate'):
        loop.run()


def test_a_checkpoint_that_does_not_fit_is_refused(make_loop: Callable[..., Loop]) -> None:
    loop = make_loop(config=dataclasses.replace(CONFIG, steps=1))
    loop.run()
    other = dataclasses.replace(CONFIG, network=dataclasses.replace(CONFIG.network, dimension=8))
    with pytest.raises(ModelError, match='does not fit the configured network'):
        make_loop(config=other, resume=True)
    whole = bytearray((loop.out / CHECKPOINT).read_bytes())
    (loop.out / CHECKPOINT).write_bytes(b'cut off')
    with pytest.raises(ModelError, match='not a readable safetensors file'):
        make_loop(resume=True)
    whole[-7] ^= 1
    (loop.out / CHECKPOINT).write_bytes(whole)
    with pytest.raises(ModelError, match='damaged or altered'):
        make_loop(resume=True)
    (loop.out / CHECKPOINT).write_bytes((loop.out / LAST).read_bytes())
    with pytest.raises(ModelError, match='not a checkpoint of a training run'):
        make_loop(resume=True)
    (loop.out / CHECKPOINT).unlink()
    with pytest.raises(ModelError, match='no such checkpoint'):
        make_loop(resume=True)


def test_logs_are_lines_of_json_without_nan(make_loop: Callable[..., Loop]) -> None:
    loop = make_loop(config=dataclasses.replace(CONFIG, steps=5))
    loop.run()
    for name in ('log', 'validation'):
        for line in (loop.out / f'{name}.jsonl').read_text().splitlines():
            json.loads(line, parse_constant=pytest.fail)


class Oracle:
    """Embeds the known place of each image as an angle, with the given U."""

    def __init__(self, images: list[np.ndarray], places: list[float], uncertainties: list[float]) -> None:
        self.known = {image.tobytes(): (p, u) for image, p, u in zip(images, places, uncertainties, strict=True)}

    def embed(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        found = [self.known[image.tobytes()] for image in images.numpy()]
        angles = torch.tensor([place / 10.0 for place, _ in found])
        mean = torch.stack([torch.cos(angles), torch.sin(angles)], dim=1)
        return mean, torch.tensor([[u, u] for _, u in found])


def test_validation_figures_against_a_plain_count(make_drive: MakeDrive) -> None:
    """Eight places, two drives; in the second, places 2 and 5 are degraded and confused with their neighbours."""
    drives = validation_drives(two_drives(make_drive), CONFIG.network, 1)
    images = [image for drive in drives for image in drive.images]
    places = [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 3.4, 3, 4, 6.4, 6, 7]
    uncertainties = [0.5] * 8 + [0.5, 0.5, 2.0, 0.5, 0.5, 0.4, 0.5, 0.5]
    figures = validate(Oracle(images, places, uncertainties).embed, drives, CONFIG.validation, torch.device('cpu'))
    # In both directions the answers for places 2 and 5 are wrong.
    assert figures['recall_at_1'] == pytest.approx(12 / 16)
    assert figures['recall_at_1_clean'] == pytest.approx(12 / 14)
    wrong = [0.5, 0.5, 2.0, 0.4]
    pairs = [(a > 0.5) + 0.5 * (a == 0.5) for a in wrong]
    assert figures['auroc_wrong'] == pytest.approx(sum(pairs) / 4)
    assert figures['score'] == pytest.approx(figures['recall_at_1'] + figures['auroc_wrong'])
    assert figures['u_clean_least'] == figures['u_clean_greatest'] == 0.5


def test_clean_medians_are_of_each_world(make_drive: MakeDrive) -> None:
    """Two worlds of two drives; U is 1 and 2 for the clean scans of each, and 9 for degraded ones."""
    made = [
        make_drive(f'{world}{lane}', world=world, lane_m=3.0 * lane, degraded=(0, 1, 2) if lane else ())
        for world in 'vw'
        for lane in range(2)
    ]
    drives = validation_drives(made, CONFIG.network, 1)
    images = [image for drive in drives for image in drive.images]
    levels = [9.0 if kind else {'v': 1.0, 'w': 2.0}[drive.world] for drive in made for kind in drive.kinds]
    oracle = Oracle(images, [float(row % 8) for row in range(32)], levels)
    figures = validate(oracle.embed, drives, CONFIG.validation, torch.device('cpu'))
    assert (figures['u_clean_least'], figures['u_clean_greatest']) == (1.0, 2.0)
