"""The effect of the second stage of training on U, one line per variant: see README.md."""

from __future__ import annotations

import argparse
import collections
import copy
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray

from offradar_ros.cli.progress import progress_bar
from offradar_ros.encoders.networks.files import load_network
from offradar_ros.encoders.networks.variational import VariationalNetwork, uncertainty
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.drives.range_reduction import Reduction
from offradar_ros.lab.evaluation.metrics.auroc import auroc
from offradar_ros.lab.evaluation.metrics.spearman import spearman
from offradar_ros.lab.training.config import DataConfig, RefinementConfig, TrainingConfig, ValidationConfig
from offradar_ros.lab.training.config_file import read_config
from offradar_ros.lab.training.refinement import (
    MAP_SPACINGS_M,
    SearchedScans,
    descriptors_of,
    feature_maps,
    search_scans,
    train_variance,
)
from offradar_ros.lab.training.searches import Search, search_pairs
from offradar_ros.lab.training.simulated_drives import simulated_drives

WEIGHTS = {
    'wrong': (1.0, 0.0, 0.0),
    'margin': (0.0, 1.0, 0.0),
    'severity': (0.0, 0.0, 1.0),
    'wrong and margin': (0.5, 0.5, 0.0),
    'all': (0.5, 0.5, 0.5),
    'all, twice the severity': (0.5, 0.5, 1.0),
}
"""Weights of ranking U by wrong answers, by margins and by severity."""
CLEAN_WEIGHTS = (0.3, 1.0, 3.0)
"""Of the level of U of clean scans, beside the configured ones."""


def main() -> None:
    """Print a Markdown table of U over the validation worlds of a training configuration."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('config', type=Path, help='training configuration with a second stage')
    parser.add_argument('weights', type=Path, help='weights of its first stage')
    parser.add_argument('--cache', type=Path, required=True, help='folder of cached scans, kept')
    arguments = parser.parse_args()
    config = read_config(arguments.config)
    network = cast(VariationalNetwork, load_network(arguments.weights)[0])
    validation = _Validation(network, _drives(config, config.validation, arguments.cache, 'validation scans'))
    searched = config.refinement.data
    trained_on = dataclasses.replace(searched, first_seed=config.data.first_seed)
    fresh, seen = (_drives(config, data, arguments.cache, 'scans to search for') for data in (searched, trained_on))
    heads = ['second stage', *(f'AUROC, {spacing_m:g} m' for spacing_m in MAP_SPACINGS_M)]
    heads += ['Spearman U–severity', 'least within a kind', 'U', 'median of clean U, by world']
    print('| ' + ' | '.join(heads) + ' |\n' + '|---' * len(heads) + '|')
    print(validation.row('none', network))
    scans = _searched(network, fresh)
    for name, (wrong, margin, severity) in WEIGHTS.items():
        changed = dataclasses.replace(
            config.refinement, wrong_weight=wrong, margin_weight=margin, severity_weight=severity
        )
        print(validation.row(name, _refined(network, scans, changed, config.seed)))
    print(validation.row('as configured', _refined(network, scans, config.refinement, config.seed)))
    for weight in CLEAN_WEIGHTS:
        changed = dataclasses.replace(config.refinement, clean_weight=weight)
        refined = _refined(network, scans, changed, config.seed)
        print(validation.row(f'as configured, clean_weight {weight:g}', refined))
    same = _refined(network, _searched(network, seen), config.refinement, config.seed)
    print(validation.row('as configured, over worlds that the network was trained on', same))


def _drives(config: TrainingConfig, data: DataConfig | ValidationConfig, cache: Path, text: str) -> list[Drive]:
    with progress_bar(text) as progress:
        reduction = Reduction.for_image(config.network)
        return cached_drives(
            simulated_drives(data), cache, reduction=reduction, processes=config.threads, progress=progress
        )


def _features(network: VariationalNetwork, drives: Sequence[Drive]) -> list[torch.Tensor]:
    with progress_bar('encoding') as progress:
        return feature_maps(network, drives, progress=progress)


def _searched(network: VariationalNetwork, drives: Sequence[Drive]) -> SearchedScans:
    return search_scans(network, drives, _features(network, drives))


def _refined(
    network: VariationalNetwork, scans: SearchedScans, config: RefinementConfig, seed: int
) -> VariationalNetwork:
    changed = copy.deepcopy(network)
    collections.deque(train_variance(changed, scans, config, seed), maxlen=0)
    return changed


class _Validation:
    """Validation drives, searched for once: the second stage does not change the answers."""

    def __init__(self, network: VariationalNetwork, drives: Sequence[Drive]) -> None:
        self._features = _features(network, drives)
        self._first = np.cumsum([0, *(len(flat) for flat in self._features)])
        self._severities = np.concatenate([drive.severities for drive in drives])
        self._worlds = np.repeat([drive.world for drive in drives], [len(drive) for drive in drives])
        self._kinds = np.array([kind for drive in drives for kind in drive.kinds])
        descriptors = [descriptors_of(network, flat) for flat in self._features]
        self._searches = [search_pairs(drives, descriptors, spacing_m) for spacing_m in MAP_SPACINGS_M]

    def row(self, name: str, network: VariationalNetwork) -> str:
        """A line of Markdown for the U of this network."""
        with torch.inference_mode():
            parts = [uncertainty(network.log_variance_of(flat.float())) for flat in self._features]
        u = torch.cat(parts).double().numpy()
        within = [
            spearman(u[self._kinds == kind], self._severities[self._kinds == kind])
            for kind in sorted(set(self._kinds.tolist()) - {''})
        ]
        cells = [f'{self._auroc(u, searched):.3f}' for searched in self._searches]
        cells += [f'{spearman(u, self._severities):.3f}', f'{min(within):.3f}', f'{u.min():.3g}–{u.max():.3g}']
        clean = [np.median(u[(self._worlds == world) & (self._severities == 0.0)]) for world in np.unique(self._worlds)]
        cells.append(f'{min(clean):.3g}–{max(clean):.3g}')
        return f'| {name} | ' + ' | '.join(cells) + ' |'

    def _auroc(self, u: NDArray[np.float64], searched: Sequence[Search]) -> float:
        of_queries = np.concatenate([u[self._first[search.queried] + search.queries] for search in searched])
        return auroc(of_queries, np.concatenate([search.margins <= 0.0 for search in searched]))


if __name__ == '__main__':
    main()
