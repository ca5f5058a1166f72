"""Validation: recognition of places in worlds without training scans, and U as a detector of wrong answers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from offradar_ros.encoders.network_config import NetworkConfig
from offradar_ros.errors import DataError
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.metrics.auroc import auroc
from offradar_ros.lab.evaluation.metrics.spearman import spearman
from offradar_ros.lab.training.config import ValidationConfig
from offradar_ros.lab.training.images import images_of
from offradar_ros.lab.training.searches import search_pairs

_IMAGES_AT_ONCE = 64

Embed = Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
"""`Network.embed`: images (N, H, W) uint8 to means (N, d) and variances (N, d)."""


class ValidationDrive(NamedTuple):
    """A cached drive and the (N, H, W) uint8 images of its scans."""

    drive: Drive
    images: NDArray[np.uint8]


def validation_drives(drives: Sequence[Drive], network: NetworkConfig, threads: int = 0) -> tuple[ValidationDrive, ...]:
    """The drives with their images; DataError if no two drives are of the same world."""
    worlds = [drive.world for drive in drives]
    if len(set(worlds)) == len(worlds):
        raise DataError('validation: expected two drives or more through at least one world')
    return tuple(ValidationDrive(drive, images_of(drive, network, threads)) for drive in drives)


def validate(
    embed: Embed, drives: Sequence[ValidationDrive], config: ValidationConfig, device: torch.device
) -> dict[str, float]:
    """Figures over all ordered pairs of drives of one world, and ``score``, by which checkpoints are chosen.

    The figures are Recall@1 over all queries and over clean ones, the AUROC of U for wrong answers, Spearman's
    correlation of U with severity, the mean and standard deviation of U, and the least and greatest of the worlds'
    medians of U over clean scans (each world has its own radar); NaN where a figure is not defined. If all answers are
    right, or all are wrong, AUROC is not defined, and Recall@1 replaces it in the score.
    """
    embedded = [_embed_all(embed, drive.images, device) for drive in drives]
    searched = search_pairs([drive.drive for drive in drives], [means for means, _ in embedded], config.map_spacing_m)
    if not sum(len(search.queries) for search in searched):
        raise DataError('validation: no scan has a place of another drive within the tolerance')
    right = np.concatenate([search.margins > 0.0 for search in searched])
    uncertainties = np.concatenate([embedded[search.queried][1][search.queries] for search in searched])
    severities = np.concatenate([drives[search.queried].drive.severities[search.queries] for search in searched])
    clean = severities == 0.0
    known = ~np.isnan(severities)
    finite = np.isfinite(uncertainties)
    figures = {
        'recall_at_1': float(right.mean()),
        'recall_at_1_clean': float(right[clean].mean()) if clean.any() else np.nan,
        'auroc_wrong': auroc(uncertainties[finite], ~right[finite]),
        'spearman_severity': spearman(uncertainties[known & finite], severities[known & finite]),
        'u_mean': float(uncertainties.mean()),
        'u_std': float(uncertainties.std()),
        **_clean_medians([drive.drive for drive in drives], [uncertainty for _, uncertainty in embedded]),
    }
    ranking = figures['recall_at_1'] if np.isnan(figures['auroc_wrong']) else figures['auroc_wrong']
    score = config.recall_weight * figures['recall_at_1'] + config.auroc_weight * ranking
    return {'score': score, **figures}


def _clean_medians(drives: Sequence[Drive], uncertainties: Sequence[NDArray[np.float64]]) -> dict[str, float]:
    clean: dict[str, list[NDArray[np.float64]]] = {}
    for drive, own in zip(drives, uncertainties, strict=True):
        clean.setdefault(drive.world, []).append(own[drive.severities == 0.0])
    medians = [float(np.median(levels)) for levels in map(np.concatenate, clean.values()) if len(levels)]
    return {
        'u_clean_least': min(medians, default=np.nan),
        'u_clean_greatest': max(medians, default=np.nan),
    }


def _embed_all(
    embed: Embed, images: NDArray[np.uint8], device: torch.device
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Descriptors (N, d) and U (N,)."""
    means, uncertainties = [], []
    with torch.inference_mode():
        for start in range(0, len(images), _IMAGES_AT_ONCE):
            mean, variance = embed(torch.from_numpy(images[start : start + _IMAGES_AT_ONCE]).to(device))
            means.append(mean.double().cpu().numpy())
            uncertainties.append(variance.double().mean(dim=1).cpu().numpy())
    return np.concatenate(means), np.concatenate(uncertainties)
