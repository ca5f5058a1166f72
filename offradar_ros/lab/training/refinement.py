"""The second stage of training: the variance head is trained with searches in maps of whole drives.

In a batch a scan is compared with a few dozen places, in a map with hundreds, so that many errors do not occur during
the first stage. Here everything but the variance head is frozen, each drive is searched for in the maps of the others,
and U is trained to rank scans by the share of wrong answers, by their margins and by severity. Descriptors do not
change.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from offradar_ros.encoders.networks.files import save_network
from offradar_ros.encoders.networks.variational import VariationalNetwork, uncertainty
from offradar_ros.errors import DataError, ModelError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.training.config import RefinementConfig, TrainingConfig
from offradar_ros.lab.training.images import images_of
from offradar_ros.lab.training.loop import BEST
from offradar_ros.lab.training.losses.clean_level import clean_level
from offradar_ros.lab.training.losses.pairwise_ranking import pairwise_ranking
from offradar_ros.lab.training.losses.prior_divergence import prior_divergence
from offradar_ros.lab.training.run_log import RunLog, draw_curves
from offradar_ros.lab.training.searches import search_pairs
from offradar_ros.lab.training.validation import ValidationDrive, validate
from offradar_ros.processes import Progress

MAP_SPACINGS_M = (5.0, 15.0)
_IMAGES_AT_ONCE = 64


class SearchedScans(NamedTuple):
    """N scans that were searched for, with the targets by which U ranks them; tensors on the CPU.

    Attributes:
        features: (N, C · h · w) float16 flattened feature maps.
        wrong: (N,) float32, share of the maps in which the answer is wrong.
        margins: (N,) float32, mean margin of the answers (see `Search`).
        severities: (N,) float32, NaN where unknown.
        worlds: (N,) int64, number of the world of each.
    """

    features: torch.Tensor
    wrong: torch.Tensor
    margins: torch.Tensor
    severities: torch.Tensor
    worlds: torch.Tensor


def feature_maps(
    network: VariationalNetwork,
    drives: Sequence[Drive],
    threads: int = 0,
    progress: Progress | None = None,
    check: Callable[[], None] | None = None,
) -> list[torch.Tensor]:
    """(N, C · h · w) float16 flattened feature maps of the scans of each drive, on the CPU.

    The network is in evaluation mode, on any device. `check` is called between drives and may raise KeyboardInterrupt.
    """
    device = network.log_variance.weight.device
    found = []
    for number, drive in enumerate(drives):
        images = torch.from_numpy(images_of(drive, network.config, threads))
        with torch.inference_mode():
            parts = [
                network.features(part.to(device)).flatten(1).half() for part in torch.split(images, _IMAGES_AT_ONCE)
            ]
        found.append(torch.cat(parts).cpu())
        if progress:
            progress(number + 1, len(drives))
        if check:
            check()
    return found


def search_scans(
    network: VariationalNetwork, drives: Sequence[Drive], features: Sequence[torch.Tensor]
) -> SearchedScans:
    """Search for every scan in the maps of all other drives through its world, with a place per 5 m and per 15 m.

    `features` are the `feature_maps` of the drives. DataError if no scan has a place of another drive nearby.
    """
    descriptors = [descriptors_of(network, flat) for flat in features]
    first = np.cumsum([0, *(len(part) for part in descriptors)])
    counts, wrong, margins = np.zeros((3, first[-1]))
    for spacing_m in MAP_SPACINGS_M:
        for search in search_pairs(drives, descriptors, spacing_m):
            scans = first[search.queried] + search.queries
            counts[scans] += 1.0
            wrong[scans] += search.margins <= 0.0
            margins[scans] += search.margins
    searched = np.flatnonzero(counts)
    if not len(searched):
        raise DataError('refinement: no scan has a place of another drive within the tolerance')
    severities = np.concatenate([drive.severities for drive in drives]).astype(np.float32)
    chosen = np.split(counts > 0.0, first[1:-1])
    numbers = {world: number for number, world in enumerate(dict.fromkeys(drive.world for drive in drives))}
    worlds = np.repeat([numbers[drive.world] for drive in drives], [len(part) for part in descriptors])
    return SearchedScans(
        torch.cat([flat[torch.from_numpy(rows)] for flat, rows in zip(features, chosen, strict=True)]),
        _tensor(wrong[searched] / counts[searched]),
        _tensor(margins[searched] / counts[searched]),
        _tensor(severities[searched]),
        torch.from_numpy(worlds[searched].astype(np.int64)),
    )


def descriptors_of(network: VariationalNetwork, flat: torch.Tensor) -> NDArray[np.float32]:
    """(N, d) unit descriptors of (N, C · h · w) feature maps."""
    with torch.inference_mode():
        found: NDArray[np.float32] = network.descriptor_of(flat.to(network.z_i.weight.device).float()).cpu().numpy()
    return found


def refine(
    config: TrainingConfig,
    network: VariationalNetwork,
    scans: SearchedScans,
    validation: Sequence[ValidationDrive],
    out: Path,
    check: Callable[[], None] | None = None,
) -> float:
    """Train the variance head by `config.refinement`, with logs in `out`.

    The network, on any device, is validated before and after; the better one is saved as ``best.safetensors`` and its
    score returned. Without validation drives the later one is saved, and the score is NaN. `check` is called between
    steps and may raise KeyboardInterrupt.
    """
    log, validation_log = RunLog(out / 'log.jsonl', 0), RunLog(out / 'validation.jsonl', 0)
    device = network.log_variance.weight.device
    steps, best = config.refinement.steps, -math.inf
    for step in (0, steps):
        if step:
            for number, terms in enumerate(train_variance(network, scans, config.refinement, config.seed), start=1):
                if number % config.log_steps == 0 or number == steps:
                    figures = {name: float(term) for name, term in terms.items()}
                    if not math.isfinite(figures['loss']):
                        raise ModelError(
                            f'{out}: the loss is no longer finite at step {number}: '
                            f'expected a lower refinement.learning_rate than {config.refinement.learning_rate:g}'
                        )
                    log.add(number, figures)
                if check:
                    check()
        figures = validate(network.embed, validation, config.validation, device) if validation else {}
        if validation:
            validation_log.add(step, figures)
        # Equal counts as better: if recall alone is the score, the second stage does not change it.
        if figures.get('score', step) >= best:
            best = figures.get('score', step)
            figures_text = ', '.join(f'{name} {value:.3f}' for name, value in figures.items())
            save_network(out / BEST, network, f'second stage, step {step}: {figures_text or "not validated"}')
    draw_curves(out)
    return best if validation else math.nan


def train_variance(
    network: VariationalNetwork, scans: SearchedScans, config: RefinementConfig, seed: int
) -> Iterator[dict[str, torch.Tensor]]:
    """Train the variance head by `config`; each iteration is one step and yields the loss and its terms.

    L = w₁ R(U, wrong) + w₂ R(U, −margin) + w₃ R(U, severity) + w₄ KL + w₅ C, where R is `pairwise_ranking` and C the
    `clean_level` of undegraded scans that were found in every map: a place may be hard to find without fault of the
    scan, and such scans keep a high U.
    """
    head = network.log_variance
    device = head.weight.device
    optimiser = torch.optim.AdamW(head.parameters(), config.learning_rate, weight_decay=config.weight_decay)
    rng = np.random.default_rng([seed, 0])
    count = len(scans.features)
    for step in range(config.steps):
        for parameters in optimiser.param_groups:
            parameters['lr'] = config.learning_rate * (1.0 - step / config.steps)
        drawn = torch.from_numpy(rng.choice(count, min(config.scans, count), replace=False))
        flat, wrong, margins, severities, worlds = (part[drawn].to(device) for part in scans)
        flat = flat.float()
        log_variance = network.log_variance_of(flat)
        uncertainties = uncertainty(log_variance)
        with torch.no_grad():
            mu = network.mu(flat)
        terms = {
            name: weight * pairwise_ranking(uncertainties, targets, config.margin)
            for name, weight, targets in (
                ('wrong', config.wrong_weight, wrong),
                ('margin', config.margin_weight, -margins),
                ('severity', config.severity_weight, severities),
            )
            if weight
        }
        terms['kl'] = config.kl_weight * prior_divergence(mu, log_variance)
        if config.clean_weight:
            found = (severities == 0.0) & (wrong == 0.0)
            terms['clean'] = config.clean_weight * clean_level(uncertainties, worlds, found)
        total = torch.stack(list(terms.values())).sum()
        optimiser.zero_grad(set_to_none=True)
        torch.autograd.backward(total)
        optimiser.step()
        yield {'loss': total.detach(), **{name: term.detach() for name, term in terms.items()}}


def _tensor(values: NDArray[np.floating]) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))
