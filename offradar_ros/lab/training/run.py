"""A whole training run: data, objective, teacher if one is needed, loop, and a folder that says how it came about."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import cv2
import numpy as np
import torch
from torch import nn

from offradar_ros import __version__
from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.encoders.networks.files import load_network
from offradar_ros.encoders.networks.variational import VariationalNetwork
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.drive import Drive, DriveSource
from offradar_ros.lab.drives.range_reduction import Reduction
from offradar_ros.lab.training.baselines.rad_vlad_codebook import fit_centres
from offradar_ros.lab.training.batches import BatchSampler
from offradar_ros.lab.training.checkpoint import read_progress
from offradar_ros.lab.training.config import DataConfig, RefinementConfig, TrainingConfig, ValidationConfig
from offradar_ros.lab.training.loop import BEST, CHECKPOINT, LAST, Loop
from offradar_ros.lab.training.objectives import make_objective, needs_teacher
from offradar_ros.lab.training.parallel import Group, joined_group
from offradar_ros.lab.training.recorded_drives import recorded_drives
from offradar_ros.lab.training.refinement import feature_maps, lessons, refine
from offradar_ros.lab.training.simulated_drives import simulated_drives
from offradar_ros.lab.training.validation import validation_drives
from offradar_ros.processes import Progress
from offradar_ros.records import unstructure, write_record

TEACHER = 'teacher'
FIRST = 'first'
"""Folder of a first stage, within that of the run whose second stage goes on from it."""

FREE_TO_CHANGE = ('validation', 'threads', 'log_steps', 'checkpoint_steps')
"""What may differ between a run and its resumption: it changes nothing that is learnt."""


class RunOptions(NamedTuple):
    """Attributes: how a run is run, beside what is learnt.

    cache: folder of cached scans, shared by runs.
    resume: whether to go on from the folder's checkpoint.
    minutes: stop, with a checkpoint, after so long, counted from the start; None for no limit.
    device: ``auto``, ``cpu`` or ``cuda``.
    progress: opens a progress bar of a text, as a function of (done, total).
    check: called between drives and steps; may raise KeyboardInterrupt.
    """

    cache: Path
    resume: bool = False
    minutes: float | None = None
    device: str = 'auto'
    progress: Callable[[str], contextlib.AbstractContextManager[Progress]] | None = None
    check: Callable[[], None] | None = None


class RunResult(NamedTuple):
    """Attributes: how far a run came.

    finished: whether all steps are done.
    step: steps done.
    best: weights with the best validation score, or the last where nothing is validated.
    score: that score; NaN where nothing is validated.
    """

    finished: bool
    step: int
    best: Path
    score: float


def run(config: TrainingConfig, out: Path, options: RunOptions) -> RunResult:
    """Train into `out`: best and last weights, a checkpoint, logs, curves, the configuration and all versions.

    ConfigError, DataError or ModelError where something is wrong with what was given. A folder with a run in it is
    left alone unless it is resumed.
    """
    _require_folder(out, options.resume)
    deadline_s = math.inf if options.minutes is None else time.monotonic() + 60.0 * options.minutes
    with joined_group(options.device) as group:
        stage = _refined if config.refinement.steps else _learnt
        return stage(config, out, options, group, deadline_s)


def _learnt(config: TrainingConfig, out: Path, options: RunOptions, group: Group, deadline_s: float) -> RunResult:
    """All but the second stage."""
    if (out / FIRST / CHECKPOINT).is_file():
        raise ConfigError(f'{out}: its run was started with a second stage: expected refinement.steps above 0')
    teacher = _given_teacher(config)
    data = _cached(config.network, config.data, options, group, 'training scans')
    if config.fit == 'rad_vlad':
        return RunResult(True, 0, fit_centres(config, data, out), math.nan)
    validation = _cached(config.network, config.validation, options, group, 'validation scans')
    if needs_teacher(config.method) and teacher is None:
        taught = _teacher(config, out, options, group, data, validation, deadline_s)
        if isinstance(taught, RunResult):
            return taught
        teacher = taught
    return _train(config, out, options, group, data, validation, deadline_s, teacher)


def _given_teacher(config: TrainingConfig) -> nn.Module | None:
    """The teacher that was trained before, if there is one; what the objective refuses is reported here, early."""
    if config.fit != 'network' or (needs_teacher(config.method) and not config.teacher.weights):
        return None
    teacher = load_network(config.teacher.weights)[0] if needs_teacher(config.method) else None
    make_objective(config, teacher)
    return teacher


def _teacher(
    config: TrainingConfig,
    out: Path,
    options: RunOptions,
    group: Group,
    data: Sequence[Drive],
    validation: Sequence[Drive],
    deadline_s: float,
) -> nn.Module | RunResult:
    """The teacher, trained here, or how far its own run came if that was stopped."""
    network = dataclasses.replace(config.network, method=config.teacher.method)
    teacher = dataclasses.replace(config, network=network, steps=config.teacher.steps)
    result = _train(teacher, out / TEACHER, options, group, data, validation, deadline_s)
    return load_network(result.best)[0] if result.finished else result


def _train(
    config: TrainingConfig,
    out: Path,
    options: RunOptions,
    group: Group,
    data: Sequence[Drive],
    validation: Sequence[Drive],
    deadline_s: float,
    teacher: nn.Module | None = None,
) -> RunResult:
    resume = options.resume and (out / CHECKPOINT).is_file()
    if resume:
        _require_same(config, read_progress(out / CHECKPOINT).config, out)
    sampler = BatchSampler(data, config.batch, config.seed, group.rank)
    sampler.batch(0)
    torch.manual_seed(config.seed)
    objective = make_objective(config, teacher)
    if group.rank == 0:
        _describe(config, out, group, objective.network, data)
    drives = validation_drives(validation, config.network, config.threads) if validation and group.rank == 0 else ()
    loop = Loop(config, objective, sampler, drives, out, group, resume)
    with _shown(
        options if group.rank == 0 else options._replace(progress=None), f'training {config.method}'
    ) as progress:
        finished = loop.run(deadline_s, progress, options.check)
    score, step = loop.best
    return RunResult(finished, loop.step, out / (BEST if step >= 0 else LAST), score if step >= 0 else math.nan)


def _refined(config: TrainingConfig, out: Path, options: RunOptions, group: Group, deadline_s: float) -> RunResult:
    """The second stage, after the first where that is not given. It is short, and not resumed: it starts again."""
    refinement = config.refinement
    if config.fit != 'network' or config.method != 'variational':
        what = config.method if config.fit == 'network' else config.fit
        raise ConfigError(f'key refinement.steps: expected 0, as {what} has no second stage')
    if (out / CHECKPOINT).is_file():
        raise ConfigError(f'{out}: its run was started without a second stage: expected refinement.steps of 0')
    worlds = [drive.world for drive in _sources(refinement.data)]
    if len(set(worlds)) == len(worlds):
        raise ConfigError('key refinement.data: expected two drives or more through at least one world')
    weights = Path(refinement.weights)
    if not refinement.weights:
        first = dataclasses.replace(config, refinement=RefinementConfig())
        result = _learnt(first, out / FIRST, options, group, deadline_s)
        if not result.finished or group.any(time.monotonic() >= deadline_s):
            return result._replace(finished=False)
        weights = result.best
    network = cast(VariationalNetwork, load_network(weights)[0])
    if network.config != config.network:
        raise ConfigError(f'{weights}: expected weights of the configured network, {config.network}')
    data = _cached(config.network, refinement.data, options, group, 'scans to search for')
    validation = _cached(config.network, config.validation, options, group, 'validation scans')
    score = -1.0
    if group.rank == 0:
        _describe(config, out, group, network, data)
        drives = validation_drives(validation, config.network, config.threads) if validation else ()
        with _shown(options, 'encoding scans to search for') as progress:
            network = network.to(group.device)
            taught = lessons(network, data, feature_maps(network, data, config.threads, progress, options.check))
        score = refine(config, network, taught, drives, out, options.check)
    (score,) = group.first_says((score,))
    return RunResult(True, refinement.steps, out / BEST, score if validation else math.nan)


def _require_folder(out: Path, resume: bool) -> None:
    there = any(
        (out / file).is_file() for file in (BEST, CHECKPOINT, f'{TEACHER}/{CHECKPOINT}', f'{FIRST}/{CHECKPOINT}')
    )
    if there and not resume:
        raise DataError(f'{out}: a training run is there: expected --resume to go on with it, or another folder')
    if resume and not there:
        raise DataError(f'{out}: no checkpoint to resume from')
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f'{out}: cannot be written ({error.strerror})') from error


def _require_same(config: TrainingConfig, before: Mapping[str, Any], out: Path) -> None:
    now, default = unstructure(config), unstructure(TrainingConfig())
    started = _completed(before, default)
    for key in now:
        if key not in FREE_TO_CHANGE and now[key] != started[key]:
            raise ConfigError(f'{out}: its run was started with another {key}: expected {started[key]!r}')


def _completed(values: Mapping[str, Any], default: dict[str, Any]) -> dict[str, Any]:
    """`values` with the keys that there were not yet when they were written: by default, nothing has changed."""
    given = {key: values.get(key, default[key]) for key in default}
    return {key: _completed(value, default[key]) if isinstance(value, dict) else value for key, value in given.items()}


def _cached(
    network: NetworkConfig, config: DataConfig | ValidationConfig, options: RunOptions, group: Group, text: str
) -> list[Drive]:
    sources = _sources(config)
    reduction = Reduction.for_image(network)
    if group.rank == 0:
        with _shown(options, text) as progress:

            def report(done: int, total: int) -> None:
                if progress:
                    progress(done, total)
                if options.check:
                    options.check()

            cached_drives(sources, options.cache, reduction=reduction, progress=report)
    group.first_says((0.0,))
    return cached_drives(sources, options.cache, reduction=reduction)


def _sources(config: DataConfig | ValidationConfig) -> list[DriveSource]:
    return [*simulated_drives(config), *recorded_drives(config)]


@contextlib.contextmanager
def _shown(options: RunOptions, text: str) -> Iterator[Progress | None]:
    if options.progress is None:
        yield None
        return
    with options.progress(text) as progress:
        yield progress


def _describe(config: TrainingConfig, out: Path, group: Group, network: nn.Module, data: Sequence[Drive]) -> None:
    """Write what the run is made from; a resumed run adds a line of where it went on."""
    out.mkdir(parents=True, exist_ok=True)
    write_record(out / 'config.yaml', config)
    device = torch.cuda.get_device_name(group.device) if group.device.type == 'cuda' else platform.processor()
    facts = {
        'offradar_ros': __version__,
        'revision': _revision(),
        'python': platform.python_version(),
        'torch': torch.__version__,
        'numpy': np.__version__,
        'opencv': cv2.__version__,
        'machine': platform.machine(),
        'device': device or group.device.type,
        'cores': len(os.sched_getaffinity(0)),
        'processes': group.size,
        'command': sys.argv,
        'parameters': sum(parameter.numel() for parameter in network.parameters()),
        'scans': sum(len(drive) for drive in data),
        'degraded_scans': sum(int(np.count_nonzero(drive.kinds != '')) for drive in data),
        'drives': len(data),
    }
    with (out / 'run.jsonl').open('a', encoding='utf-8') as file:
        file.write(json.dumps(facts) + '\n')


def _revision() -> str:
    """Git revision of the source tree, with + where files differ from it; empty where there is none."""
    folder = Path(__file__).parent
    try:
        asked = ['git', 'describe', '--always', '--abbrev=40', '--dirty=+', '--exclude=*']
        done = subprocess.run(asked, cwd=folder, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ''
    return done.stdout.strip()
