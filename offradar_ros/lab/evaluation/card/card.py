"""The content of a model card: results of one method and of those it is compared with, and the author's remarks."""

from __future__ import annotations

import dataclasses

from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.results.figure import Interval
from offradar_ros.lab.evaluation.results.open_set import OpenSetFigures
from offradar_ros.lab.evaluation.results.results import ByMap
from offradar_ros.lab.evaluation.results.uncertainty import RecordedUncertainty
from offradar_ros.records import Measure


@dataclasses.dataclass(frozen=True)
class CardWeights:
    """The weights that the card describes.

    Attributes:
        file: its name.
        sha256: of the file.
        size_bytes: of the file.
        fingerprint: of the model.
        dimension: d of the embedding.
        settings: of the network, JSON.
    """

    file: str
    sha256: str
    size_bytes: int
    fingerprint: str
    dimension: int
    settings: str


@dataclasses.dataclass(frozen=True)
class CardFigures:
    """Figures of one method, group and map spacing: those of `SearchFigures` under the same names."""

    recall_at_1: Interval
    recall_at_1_clean: Interval
    auroc_wrong: Interval
    auroc_wrong_by_severity: Measure
    auroc_wrong_by_other_maps: Measure
    auc_recall_at_rejection: Interval
    recall_at_rejection: tuple[tuple[Measure, Measure], ...]


@dataclasses.dataclass(frozen=True)
class CardAblation:
    """Recall@1 of O, M, M_random, Q and QM, and the share of the queries that Q rejects."""

    recall_at_1: dict[str, Measure]
    rejected: Measure


@dataclasses.dataclass(frozen=True)
class CardUncertainty:
    """U of the method over the scans of all groups: those of `UncertaintyFigures` under the same names."""

    scans: int
    mean: Measure
    least: Measure
    quantile_95: Measure
    greatest: Measure
    mean_by_kind: dict[str, Measure]


@dataclasses.dataclass(frozen=True)
class Card:
    """A model card; its Markdown contains what is here, and nothing else.

    The figures up to `map_maintenance` are over all groups, with the protocol's first map spacing.

    Attributes:
        recall_at_1: by method.
        recall_at_1_clean: by method.
        auroc_wrong: by method.
        auc_recall_at_rejection: by method.
        recall_at_rejection: by method, (rejected share, Recall@1 of the rest).
        spearman_severity: rank correlation of U with severity, over all scans and by kind.
        map_maintenance: Recall@1 of O, M, M_random, Q and QM; empty where no map was maintained.
        worlds: that were searched.
        seeds: of every world.
        command: the command of the evaluation.
        name: of the weights.
        method: its name in the results.
        weights: the file.
        remarks: of the author, Markdown: intended use, limits and the like.
        training: configuration of the training run, YAML; empty if not given.
        card_command: the command that made the card.
        created: when the results were measured, ISO 8601.
        versions: of the software that measured them.
        protocol: what was measured.
        skipped: notes on what was not measured.
        threshold: the one in use, NaN for none.
        groups: figures of searches.
        maintenance: of the method, by group and map spacing.
        uncertainty: U of the method.
        recorded: U of recorded scans, of this method only; None if not measured.
        open_set: right answers of the method against wrong ones and queries off the map, without the precisions of
            curves, by group and map spacing; empty in older cards.
        open_set_command: command that measured `open_set`, where that is another than `command`.
    """

    recall_at_1: dict[str, Measure]
    recall_at_1_clean: dict[str, Measure]
    auroc_wrong: dict[str, Measure]
    auc_recall_at_rejection: dict[str, Measure]
    recall_at_rejection: dict[str, tuple[tuple[Measure, Measure], ...]]
    spearman_severity: dict[str, Measure]
    map_maintenance: dict[str, Measure]
    worlds: tuple[str, ...]
    seeds: tuple[int, ...]
    command: str
    name: str
    method: str
    weights: CardWeights
    remarks: str
    training: str
    card_command: str
    created: str
    versions: dict[str, str]
    protocol: Protocol
    skipped: tuple[str, ...]
    threshold: Measure
    groups: ByMap[CardFigures]
    maintenance: dict[str, dict[str, CardAblation]]
    uncertainty: CardUncertainty
    recorded: RecordedUncertainty | None
    open_set: dict[str, dict[str, OpenSetFigures]] = dataclasses.field(default_factory=dict)
    open_set_command: str = ''
