"""A card from results."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

import yaml

from offradar_ros.bounded_input import parse_yaml, read_text
from offradar_ros.encoders.model_files import read_model_file
from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.card.card import Card, CardAblation, CardFigures, CardUncertainty, CardWeights
from offradar_ros.lab.evaluation.methods import OURS
from offradar_ros.lab.evaluation.protocol import ALL
from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.results.method import MethodRecord
from offradar_ros.lab.evaluation.results.open_set import OpenSetFigures
from offradar_ros.lab.evaluation.results.results import Results, spacing_key
from offradar_ros.lab.evaluation.results.search import SearchFigures
from offradar_ros.lab.evaluation.results.uncertainty import UncertaintyFigures


@dataclasses.dataclass(frozen=True)
class CardSources:
    """What a card is made of, apart from results.

    Attributes:
        name: of the weights.
        weights: their file.
        fingerprint: of the model in that file.
        command: that makes the card.
        remarks: of the author, Markdown.
        training: folder of the training run, or None.
    """

    name: str
    weights: Path
    fingerprint: str
    command: str
    remarks: str = ''
    training: Path | None = None


def make_card(results: Results, sources: CardSources) -> Card:
    """The card of the weights of method ours.

    DataError if the results lack this method or are of other weights, or if a file cannot be read.
    """
    require_ours(results)
    method = results.methods[OURS]
    first = spacing_key(results.protocol.map_spacings_m[0])
    headline = results.groups[ALL][first]
    ablations = {
        group: {
            spacing: CardAblation(methods[OURS].recall_at_1, methods[OURS].rejected)
            for spacing, methods in spacings.items()
            if OURS in methods
        }
        for group, spacings in results.maintenance.items()
    }
    recorded = results.recorded
    if recorded:
        recorded = dataclasses.replace(recorded, methods={OURS: recorded.methods[OURS]})
    return Card(
        recall_at_1={name: figures.recall_at_1.value for name, figures in headline.items()},
        recall_at_1_clean={name: figures.recall_at_1_clean.value for name, figures in headline.items()},
        auroc_wrong={name: figures.auroc_wrong.value for name, figures in headline.items()},
        auc_recall_at_rejection={name: figures.auc_recall_at_rejection.value for name, figures in headline.items()},
        recall_at_rejection={name: figures.recall_at_rejection for name, figures in headline.items()},
        spearman_severity=results.uncertainty[ALL][OURS].spearman_severity,
        map_maintenance=ablations[ALL][first].recall_at_1 if first in ablations[ALL] else {},
        worlds=results.worlds,
        seeds=results.seeds,
        command=results.command,
        name=sources.name,
        method=OURS,
        weights=_weights(sources, method),
        remarks=sources.remarks,
        training='' if sources.training is None else _training(sources.training),
        card_command=sources.command,
        created=results.created,
        versions=results.versions,
        protocol=results.protocol,
        skipped=results.skipped,
        threshold=method.thresholds.deployed,
        groups={
            group: {
                spacing: {name: _figures(figures) for name, figures in methods.items()}
                for spacing, methods in spacings.items()
            }
            for group, spacings in results.groups.items()
        },
        maintenance={group: spacings for group, spacings in ablations.items() if spacings},
        uncertainty=_uncertainty(results.uncertainty[ALL][OURS]),
        recorded=recorded,
        open_set=_open_set(results),
    )


def with_open_set(card: Card, results: Results) -> Card:
    """The card with the queries on and off the map of other results, of maps of which a part is left out.

    DataError unless they are of the same weights, and of such maps.
    """
    require_ours(results)
    if not results.protocol.leaves_out:
        raise DataError(f'results of {results.protocol.name}: expected a protocol that leaves out a part of each map')
    found = results.methods[OURS].fingerprint
    if found != card.weights.fingerprint:
        raise DataError(f'results of {found[:12]}: expected those of the card, {card.weights.fingerprint[:12]}')
    return dataclasses.replace(card, open_set=_open_set(results), open_set_command=results.command)


def _open_set(results: Results) -> dict[str, dict[str, OpenSetFigures]]:
    return {
        group: {spacing: _without_curves(methods[OURS].open_set) for spacing, methods in spacings.items()}
        for group, spacings in results.groups.items()
    }


def require_ours(results: Results) -> None:
    """DataError if the results have no method ours."""
    if OURS not in results.methods:
        raise DataError('results: expected the method ours: run offradar evaluate with --method ours=WEIGHTS')


def _weights(sources: CardSources, method: MethodRecord) -> CardWeights:
    content = read_model_file(sources.weights)
    if sources.fingerprint != method.fingerprint:
        raise DataError(
            f'{sources.weights}: its fingerprint is {sources.fingerprint[:12]}, the results are of '
            f'{method.fingerprint[:12]}'
        )
    return CardWeights(
        file=sources.weights.name,
        sha256=hashlib.sha256(content).hexdigest(),
        size_bytes=len(content),
        fingerprint=method.fingerprint,
        dimension=method.dimension,
        settings=method.settings.get('settings', ''),
    )


def _training(folder: Path) -> str:
    path = folder / 'config.yaml'
    try:
        text = read_text(path)
        parse_yaml(text)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise DataError(f'{path}: expected the configuration of a training run ({error})') from None
    return text.strip()


def _figures(figures: SearchFigures) -> CardFigures:
    return CardFigures(
        recall_at_1=_interval(figures.recall_at_1),
        recall_at_1_clean=_interval(figures.recall_at_1_clean),
        auroc_wrong=_interval(figures.auroc_wrong),
        auroc_wrong_by_severity=figures.auroc_wrong_by_severity,
        auroc_wrong_by_other_maps=figures.auroc_wrong_by_other_maps,
        auc_recall_at_rejection=_interval(figures.auc_recall_at_rejection),
        recall_at_rejection=figures.recall_at_rejection,
    )


def _without_curves(figures: OpenSetFigures) -> OpenSetFigures:
    short = {name: dataclasses.replace(found, precisions=()) for name, found in figures.confidences.items()}
    return dataclasses.replace(figures, confidences=short)


def _interval(figure: Interval) -> Interval:
    return Interval(figure.value, figure.low, figure.high)


def _uncertainty(figures: UncertaintyFigures) -> CardUncertainty:
    names = [field.name for field in dataclasses.fields(CardUncertainty)]
    return CardUncertainty(**{name: getattr(figures, name) for name in names})
