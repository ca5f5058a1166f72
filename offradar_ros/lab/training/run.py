"""A whole training run: data, objective, teacher if one is needed, loop, and a record of all settings."""

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
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from offradar_ros import __version__
from offradar_ros.encoders.networks.files import load_network
from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.networks.variational import VariationalNetwork
from offradar_ros.encoders.weights import read_header
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.drive import Drive, DriveSource
from offradar_ros.lab.drives.range_reduction import Reduction
from offradar_ros.lab.training.baselines.rad_vlad_codebook import fit_centres
from offradar_ros.lab.training.batches import BatchSampler
from offradar_ros.lab.training.checkpoint import read_progress
from offradar_ros.lab.training.config import (
    DataConfig,
    InitialConfig,
    RefinementConfig,
    TrainingConfig,
    ValidationConfig,
)
from offradar_ros.lab.training.initial_weights import start_from
from offradar_ros.lab.training.loop import BEST, CHECKPOINT, LAST, Loop
from offradar_ros.lab.training.objective import Objective
from offradar_ros.lab.training.objectives import make_objective, needs_teacher
from offradar_ros.lab.training.parallel import Group, process_group
from offradar_ros.lab.training.recorded_drives import recorded_drives
from offradar_ros.lab.training.refinement import feature_maps, refine, search_scans
from offradar_ros.lab.training.simulated_drives import simulated_drives
from offradar_ros.lab.training.teacher_outputs import load_teacher, teacher_outputs, weights_of
from offradar_ros.lab.training.validation import validation_drives
from offradar_ros.processes import Progress
from offradar_ros.records import unstructure, write_record

TEACHER = 'teacher'
FIRST = 'first'
"""Folder of the first stage, within that of a run with a second stage."""

FREE_TO_CHANGE = ('validation', 'threads', 'log_steps', 'checkpoint_steps')
"""Keys that may differ when a run is resumed: they do not change the trained weights."""


class RunOptions(NamedTuple):
    """Options of a run that do not change the trained weights.

    Attributes:
        cache: folder of cached scans, shared by runs.
        resume: whether to resume from the checkpoint in the folder of the run.
        minutes: time limit, counted from the start, after which the run stops with a checkpoint; None for no limit.
        device: ``auto``, ``cpu`` or ``cuda``.
        progress: opens a progress bar with a text, and gives its function of (done, total).
        check: called between drives and steps; may raise KeyboardInterrupt.
    """

    cache: Path
    resume: bool = False
    minutes: float | None = None
    device: str = 'auto'
    progress: Callable[[str], contextlib.AbstractContextManager[Progress]] | None = None
    check: Callable[[], None] | None = None


class RunResult(NamedTuple):
    """Result of a run.

    Attributes:
        finished: whether all steps are done.
        step: steps done.
        best: weights with the best validation score, or the last ones without validation.
        score: that score; NaN without validation.
    """

    finished: bool
    step: int
    best: Path
    score: float


class _Context(NamedTuple):
    """Attributes of a run that its parts share; `deadline_s` is a value of ``time.monotonic()``."""

    options: RunOptions
    group: Group
    deadline_s: float


def run(config: TrainingConfig, out: Path, options: RunOptions) -> RunResult:
    """Train, and write into `out` the best and last weights, a checkpoint, logs, curves, configuration and versions.

    ConfigError, DataError or ModelError for settings, data or weights that cannot be used, and DataError if `out` has a
    run that is not resumed.
    """
    _require_folder(out, options.resume)
    deadline_s = math.inf if options.minutes is None else time.monotonic() + 60.0 * options.minutes
    with process_group(options.device) as group:
        if config.batch.chunk and group.size > 1:
            # Their gradients are averaged while one backward pass runs, and chunks have several.
            raise ConfigError(f'key batch.chunk: expected 0 with {group.size} processes, got {config.batch.chunk}')
        stages = _both_stages if config.refinement.steps else _first_stage
        return stages(config, out, _Context(options, group, deadline_s))


def _first_stage(config: TrainingConfig, out: Path, context: _Context) -> RunResult:
    """Train the network, after its teacher if it needs one, or fit the centres."""
    if (out / FIRST / CHECKPOINT).is_file():
        raise ConfigError(f'{out}: its run was started with a second stage: expected refinement.steps above 0')
    teacher = _load_teacher(config, (out / CHECKPOINT).is_file())
    data = _cached(config, config.data, context, 'training scans')
    if config.fit == 'rad_vlad':
        return RunResult(True, 0, fit_centres(config, data, out), math.nan)
    validation = _cached(config, config.validation, context, 'validation scans')
    if needs_teacher(config.method) and teacher is None:
        trained = _train_teacher(config, out, context, data, validation)
        if isinstance(trained, RunResult):
            return trained
        teacher = trained
    return _train(config, out, context, data, validation, teacher)


def _load_teacher(config: TrainingConfig, is_started: bool) -> Network | None:
    """The teacher of `teacher.weights`, if given. Settings that cannot be trained are reported here, early."""
    if config.fit != 'network':
        return None
    if config.distillation.weights:
        load_teacher(config.distillation, config.network)
    if needs_teacher(config.method) and not config.teacher.weights:
        return None
    teacher = load_network(config.teacher.weights)[0] if needs_teacher(config.method) else None
    _objective(config, teacher, is_started)
    return teacher


def _objective(config: TrainingConfig, teacher: Network | None, is_started: bool) -> Objective:
    """The objective, with initial weights of `initial.weights`; a run that was started needs that file no more."""
    torch.manual_seed(config.seed)
    objective = make_objective(config, teacher)
    if config.initial.weights and not is_started:
        start_from(objective.network, config.initial.weights)
    return objective


def _train_teacher(
    config: TrainingConfig,
    out: Path,
    context: _Context,
    data: Sequence[Drive],
    validation: Sequence[Drive],
) -> Network | RunResult:
    """The trained teacher, or the result of its run if that was stopped."""
    network = dataclasses.replace(config.network, method=config.teacher.method)
    teacher = dataclasses.replace(config, network=network, steps=config.teacher.steps, initial=InitialConfig())
    result = _train(teacher, out / TEACHER, context, data, validation)
    return load_network(result.best)[0] if result.finished else result


def _train(
    config: TrainingConfig,
    out: Path,
    context: _Context,
    data: Sequence[Drive],
    validation: Sequence[Drive],
    teacher: Network | None = None,
) -> RunResult:
    options, group, deadline_s = context
    resume = options.resume and (out / CHECKPOINT).is_file()
    if resume:
        _require_same(config, read_progress(out / CHECKPOINT).config, out)
    sampler = BatchSampler(data, config.batch, config.seed, group.rank)
    sampler.batch(0)
    objective = _objective(config, teacher, resume)
    targets = _targets(config, data, context) if config.distillation.weights else None
    if group.rank == 0:
        _describe(config, out, group, objective.network, data)
    drives = validation_drives(validation, config.network, config.threads) if validation and group.rank == 0 else ()
    loop = Loop(config, objective, sampler, drives, out, group, resume, targets)
    with _shown(
        options if group.rank == 0 else options._replace(progress=None), f'training {config.method}'
    ) as progress:
        finished = loop.run(deadline_s, progress, options.check)
    score, step = loop.best
    return RunResult(finished, loop.step, out / (BEST if step >= 0 else LAST), score if step >= 0 else math.nan)


def _both_stages(config: TrainingConfig, out: Path, context: _Context) -> RunResult:
    """Train the first stage, unless its weights are given, and the second, which is short and not resumable."""
    refinement, (options, group, deadline_s) = config.refinement, context
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
        result = _first_stage(first, out / FIRST, context)
        if not result.finished or group.any(time.monotonic() >= deadline_s):
            return result._replace(finished=False)
        weights = result.best
    network, _ = load_network(weights)
    if not isinstance(network, VariationalNetwork) or network.config != config.network:
        raise ConfigError(f'{weights}: expected weights of the configured network, {config.network}')
    data = _cached(config, refinement.data, context, 'scans to search for')
    validation = _cached(config, config.validation, context, 'validation scans')
    score = -1.0
    if group.rank == 0:
        _describe(config, out, group, network, data)
        drives = validation_drives(validation, config.network, config.threads) if validation else ()
        with _shown(options, 'encoding scans to search for') as progress:
            network = network.to(group.device)
            features = feature_maps(network, data, config.threads, progress, options.check)
        score = refine(config, network, search_scans(network, data, features), drives, out, options.check)
    (score,) = group.broadcast((score,))
    return RunResult(True, refinement.steps, out / BEST, score if validation else math.nan)


def _require_folder(out: Path, resume: bool) -> None:
    exists = any(
        (out / file).is_file() for file in (BEST, CHECKPOINT, f'{TEACHER}/{CHECKPOINT}', f'{FIRST}/{CHECKPOINT}')
    )
    if exists and not resume:
        raise DataError(f'{out}: has a training run already: expected --resume to continue it, or another folder')
    if resume and not exists:
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
    """`values` with the default of each key that did not exist when they were written."""
    given = {key: values.get(key, default[key]) for key in default}
    return {key: _completed(value, default[key]) if isinstance(value, dict) else value for key, value in given.items()}


def _cached(config: TrainingConfig, data: DataConfig | ValidationConfig, context: _Context, text: str) -> list[Drive]:
    options, group, _ = context
    sources = _sources(data)
    reduction = _reduction(config)
    if group.rank == 0:
        with _shown(options, text) as progress:

            def report(done: int, total: int) -> None:
                if progress:
                    progress(done, total)
                if options.check:
                    options.check()

            cached_drives(sources, options.cache, reduction=reduction, progress=report)
    group.broadcast((0.0,))
    return cached_drives(sources, options.cache, reduction=reduction)


def _reduction(config: TrainingConfig) -> Reduction:
    """As fine, and as far, as the images of the network and of its teacher need."""
    images = [config.network]
    if config.distillation.weights:
        images.append(read_header(weights_of(config.distillation)).config)
    wanted = [Reduction.for_image(image) for image in images]
    steps_m = [reduction.step_m for reduction in wanted] + [config.cached_bin_m] * bool(config.cached_bin_m)
    return Reduction(min(steps_m), max(reduction.reach_m for reduction in wanted))


def _targets(config: TrainingConfig, data: Sequence[Drive], context: _Context) -> NDArray[np.float16]:
    """The outputs of the teacher of distillation for all scans; the first process computes what is not cached."""
    options, group, _ = context
    teacher = load_teacher(config.distillation, config.network)
    if group.rank == 0:
        with _shown(options, 'what the teacher sees') as progress:
            teacher_outputs(teacher, data, options.cache, group.device, config.threads, progress, options.check)
    group.broadcast((0.0,))
    return teacher_outputs(teacher, data, options.cache, group.device, config.threads)


def _sources(config: DataConfig | ValidationConfig) -> list[DriveSource]:
    return [*simulated_drives(config), *recorded_drives(config)]


@contextlib.contextmanager
def _shown(options: RunOptions, text: str) -> Iterator[Progress | None]:
    if options.progress is None:
        yield None
        return
    with options.progress(text) as progress:
        yield progress


def _describe(config: TrainingConfig, out: Path, group: Group, network: Network, data: Sequence[Drive]) -> None:
    """Write the configuration and, as a line of JSON, versions, machine and data; a resumed run appends a line."""
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
    try:
        with (out / 'run.jsonl').open('a', encoding='utf-8') as file:
            file.write(json.dumps(facts) + '\n')
    except OSError as error:
        raise DataError(f'{out / "run.jsonl"}: cannot be written ({error.strerror})') from error


def _revision() -> str:
    """Git revision of the source tree, with + if files differ from it; empty without one."""
    folder = Path(__file__).parent
    try:
        command = ['git', 'describe', '--always', '--abbrev=40', '--dirty=+', '--exclude=*']
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return ''
    return done.stdout.strip()
