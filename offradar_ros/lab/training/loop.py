"""The training loop: draw, train, log, validate, save; a resumed run gives the same result."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from offradar_ros.encoders.networks.files import save_network
from offradar_ros.encoders.networks.network import Network
from offradar_ros.errors import ModelError
from offradar_ros.lab.training.batch_norm_statistics import reestimate_batch_norm
from offradar_ros.lab.training.batches import BatchSampler
from offradar_ros.lab.training.checkpoint import Progress, load_checkpoint, save_checkpoint
from offradar_ros.lab.training.config import TrainingConfig
from offradar_ros.lab.training.gradient_cache import chunked_backward
from offradar_ros.lab.training.images import ImageBatch, image_batches
from offradar_ros.lab.training.muon import Muon
from offradar_ros.lab.training.objective import Objective, Views, total_of
from offradar_ros.lab.training.parallel import Group
from offradar_ros.lab.training.run_log import RunLog, draw_curves
from offradar_ros.lab.training.schedule import learning_rate
from offradar_ros.lab.training.validation import ValidationDrive, validate
from offradar_ros.lab.training.weight_average import WeightAverage
from offradar_ros.records import unstructure

CHECKPOINT = 'checkpoint.safetensors'
BEST = 'best.safetensors'
LAST = 'last.safetensors'
_STATISTICS_BATCHES = 30
"""Batches that the statistics of batch normalisation are re-estimated over."""


class Loop:
    """Trains the network of one objective and writes the results into a folder."""

    def __init__(
        self,
        config: TrainingConfig,
        objective: Objective,
        sampler: BatchSampler,
        validation: Sequence[ValidationDrive],
        out: Path,
        group: Group,
        resume: bool = False,
        targets: NDArray[np.float16] | None = None,
    ) -> None:
        """With `resume`, from the checkpoint in `out`; ModelError if it does not fit.

        `targets` are the `teacher_outputs` of the sampler's scans, if there is such a teacher. With `batch.chunk` the
        group has one process.
        """
        self.config = config
        self.objective = objective
        self.out = out
        self._sampler = sampler
        self._validation = validation
        self._group = group
        self._targets = targets
        layout = torch.channels_last if config.channels_last else torch.contiguous_format
        self._network: Network = objective.network.to(device=group.device, memory_format=layout)  # type: ignore[call-overload]
        self._parameters = list(self._network.parameters())
        self._optimiser = _optimiser(config, self._parameters)
        self._scaler = torch.amp.GradScaler(group.device.type, enabled=config.precision == 'amp')
        average = config.optimiser.average
        self._average = WeightAverage(self._network, average) if average else None
        self._judged = self._average.network if self._average else self._network
        self._frozen = False
        self._step, self._best = 0, (-1.0, -1)
        if resume:
            averaged = self._judged if self._average else None
            self._restore(load_checkpoint(out / CHECKPOINT, self._network, self._optimiser, averaged))
        self._losses = group.data_parallel(objective)
        if group.rank == 0:
            self._log = RunLog(out / 'log.jsonl', self._step)
            self._validation_log = RunLog(out / 'validation.jsonl', self._step)

    @property
    def step(self) -> int:
        """Steps done."""
        return self._step

    @property
    def best(self) -> tuple[float, int]:
        """The highest validation score, and its step; both −1 before the first validation."""
        return self._best

    def run(
        self,
        deadline_s: float = math.inf,
        progress: Callable[[int, int], None] | None = None,
        check: Callable[[], None] | None = None,
    ) -> bool:
        """Train until all steps are done or ``time.monotonic()`` passes `deadline_s`; returns whether all are done.

        A checkpoint is written in both cases. `check` is called between steps and may raise KeyboardInterrupt, which
        is raised again after the checkpoint is written.
        """
        steps = range(self._step, self.config.steps)
        batches = image_batches(
            self._sampler, self.config.network, steps, self.config.threads, self._group.device.type == 'cuda'
        )
        meter = _Meter()
        with contextlib.closing(batches):
            for batch in batches:
                terms, norm = self._train(batch)
                meter.add(terms, norm, len(batch.images))
                self._step += 1
                done = self._step == self.config.steps
                if done or self._step % self.config.log_steps == 0:
                    self._write(meter)
                if done or self._step % self.config.validation.every_steps == 0:
                    self._validate()
                if progress:
                    progress(self._step, self.config.steps)
                if done or self._must_stop(deadline_s, check):
                    break
                if self._step % self.config.checkpoint_steps == 0:
                    self._save()
        self._save()
        score, step = self._group.broadcast(self._best)
        self._best = score, int(step)
        if check:
            check()
        return self._step >= self.config.steps

    def _train(self, batch: ImageBatch) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
        """One step; returns its loss terms and the norm of the gradient before clipping."""
        config, step, group = self.config, self._step, self._group
        seeds = np.random.SeedSequence([config.seed, group.rank, step]).generate_state(1, np.uint64)
        torch.manual_seed(int(seeds[0]))
        rate = learning_rate(config.optimiser, step, config.steps)
        for parameters in self._optimiser.param_groups:
            parameters['lr'] = rate
        self._network.train()
        self._freeze()
        self._optimiser.zero_grad(set_to_none=True)
        views = self._views(batch)
        if 0 < config.batch.chunk < len(views.images):
            terms = chunked_backward(
                self.objective, views, step, config.batch.chunk, self._precision, self._scaler.scale
            )
        else:
            with self._precision():
                terms = self._losses(views, step)
            torch.autograd.backward(self._scaler.scale(total_of(terms)))
        self._scaler.unscale_(self._optimiser)
        norm = torch.nn.utils.clip_grad_norm_(self._parameters, config.optimiser.clip_norm or math.inf)
        self._scaler.step(self._optimiser)
        self._scaler.update()
        if self._average:
            self._average.update(self._network, step)
        return {'loss': total_of(terms).detach(), **{name: term.detach() for name, term in terms.items()}}, norm

    def _freeze(self) -> None:
        """Freeze the first groups of the backbone, if it is time: the backward pass ends before them."""
        settings = self.config.optimiser
        if self._frozen or not settings.frozen_groups or self._step < settings.frozen_from * self.config.steps:
            return
        for layers in self._network.features.backbone.groups[: settings.frozen_groups]:
            layers.requires_grad_(False)
        self._losses = self._group.data_parallel(self.objective)
        self._frozen = True

    def _views(self, batch: ImageBatch) -> Views:
        scans, device = batch.batch.scans, self._group.device
        images = batch.images.to(device, non_blocking=True)
        severities = torch.from_numpy(self._sampler.severities[scans]).to(device)
        if self._targets is None:
            return Views(images, severities)
        return Views(images, severities, torch.from_numpy(self._targets[scans].astype(np.float32)).to(device))

    def _precision(self) -> torch.autocast:
        mixed = {'fp32': None, 'bf16': torch.bfloat16, 'amp': torch.float16}[self.config.precision]
        return torch.autocast(self._group.device.type, dtype=mixed, enabled=mixed is not None)

    def _must_stop(self, deadline_s: float, check: Callable[[], None] | None) -> bool:
        """Whether to stop early. Several processes exchange this only with each line of the log."""
        if self._group.size > 1 and self._step % self.config.log_steps:
            return False
        stop = time.monotonic() >= deadline_s
        if check:
            try:
                check()
            except KeyboardInterrupt:
                stop = True
        return self._group.any(stop)

    def _write(self, meter: _Meter) -> None:
        figures = meter.means()
        if self._group.any(not math.isfinite(figures['loss'])):
            raise ModelError(
                f'{self.out}: the loss is no longer finite at step {self._step}: '
                f'expected a lower optimiser.learning_rate than {self.config.optimiser.learning_rate:g}'
            )
        if self._group.rank == 0:
            rate = learning_rate(self.config.optimiser, self._step - 1, self.config.steps)
            self._log.add(self._step, {**figures, 'learning_rate': rate})

    def _validate(self) -> None:
        """Validate the network and save it if it is the best so far, in the first process alone."""
        if not self._validation or self._group.rank:
            return
        self._reestimate_batch_norm()
        figures = validate(self._judged.embed, self._validation, self.config.validation, self._group.device)
        self._validation_log.add(self._step, figures)
        if figures['score'] > self._best[0]:
            self._best = figures['score'], self._step
            figures_text = ', '.join(f'{name} {value:.3f}' for name, value in figures.items())
            save_network(self.out / BEST, self._judged, f'step {self._step}: {figures_text}')

    def _reestimate_batch_norm(self) -> None:
        steps = range(self._step, self._step + _STATISTICS_BATCHES)
        batches = image_batches(self._sampler, self.config.network, steps, self.config.threads)
        with contextlib.closing(batches):
            reestimate_batch_norm(self._judged, (batch.images.to(self._group.device) for batch in batches))

    def _save(self) -> None:
        if self._group.rank == 0:
            score, step = self._best
            progress = Progress(self._step, score, step, self._scaler.state_dict(), unstructure(self.config))
            averaged = self._judged if self._average else None
            save_checkpoint(self.out / CHECKPOINT, self._network, self._optimiser, progress, averaged)
            save_network(self.out / LAST, self._judged, f'step {self._step}')
            draw_curves(self.out)

    def _restore(self, progress: Progress) -> None:
        self._step = progress.step
        # Scores by other worlds or weights are not comparable: the best is then sought from here on.
        if _scoring(progress.config) == _scoring(unstructure(self.config)):
            self._best = progress.best_score, progress.best_step
        self._scaler.load_state_dict(dict(progress.scaler))


def _scoring(config: Mapping[str, Any]) -> dict[str, Any]:
    """What a validation score depends on beside the weights."""
    return {key: value for key, value in config['validation'].items() if key != 'every_steps'}


def _optimiser(config: TrainingConfig, parameters: list[torch.nn.Parameter]) -> torch.optim.Optimizer:
    settings = config.optimiser
    if settings.name == 'muon':
        return Muon(parameters, settings.learning_rate, settings.matrix_rate, settings.weight_decay)
    make = torch.optim.AdamW if settings.name == 'adamw' else torch.optim.Adam
    # One pass over the weights instead of a dozen.
    return make(parameters, lr=settings.learning_rate, weight_decay=settings.weight_decay, fused=True)


class _Meter:
    """Means over the steps since the last line of the log. Sums stay on the device: to read one waits for it."""

    def __init__(self) -> None:
        self._reset()

    def _reset(self) -> None:
        self._sums: dict[str, torch.Tensor] = {}
        self._steps = self._images = 0
        self._since = time.monotonic()

    def add(self, terms: dict[str, torch.Tensor], norm: torch.Tensor, images: int) -> None:
        for name, value in {**terms, 'gradient_norm': norm}.items():
            self._sums[name] = self._sums[name] + value if name in self._sums else value
        self._steps += 1
        self._images += images

    def means(self) -> dict[str, float]:
        """The means since the last call."""
        figures = {name: float(total) / self._steps for name, total in self._sums.items()}
        figures['images_per_s'] = self._images / max(1e-9, time.monotonic() - self._since)
        self._reset()
        return figures
