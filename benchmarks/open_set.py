"""What each term of the probability is worth, and what larger maps change: see README.md."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from embedded_worlds import options_of, worlds_parser
from numpy.typing import NDArray

from offradar_ros.calibration.confidence_fit import fit_confidence
from offradar_ros.calibration.probability_scores import expected_calibration_error
from offradar_ros.config import ConfidenceConfig, QueryConfig
from offradar_ros.lab.evaluation.confidence import (
    Embedded,
    Setting,
    embed,
    joined,
    open_sets_of,
    settings,
)
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive
from offradar_ros.lab.evaluation.evaluate import Options
from offradar_ros.lab.evaluation.open_set import OpenSet
from offradar_ros.lab.evaluation.open_set_summary import PRECISIONS, confidence_figures, gate_figures
from offradar_ros.lab.evaluation.protocol import Protocol
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.retrieval.confidence import TERMS, confidence_for, log_odds, probability, terms_of
from offradar_ros.retrieval.evidence import EvidenceTable

Score = Callable[[EvidenceTable], NDArray[np.float64]]


def main() -> None:
    """Print tables in Markdown for each group of the protocol and each kind of map."""
    parser = worlds_parser(__doc__)
    parser.add_argument('--fitted-on', default='confidence', help='protocol for the ablation of the terms')
    parser.add_argument('--add', metavar='PROTOCOL', help='also add the places of all drives of this one to every map')
    arguments = parser.parse_args()
    options = options_of(arguments)
    protocol = read_protocol(arguments.protocol)
    info, worlds = embed(protocol, arguments.method, options)
    shipped = confidence_for(info.fingerprint, ConfidenceConfig())
    if shipped is None:
        parser.error(f'{arguments.method}: no coefficients ship for its model')
    scores: dict[str, Score] = {
        **{term: _term(column, shipped) for column, term in enumerate(TERMS)},
        'p_right': lambda evidence: log_odds(evidence, shipped),
    }
    drives = max(len(drives) for drives in worlds.values())
    more: list[list[EmbeddedDrive]] = []
    if arguments.add:
        more = list(embed(read_protocol(arguments.add), arguments.method, options)[1].values())
    else:
        scores |= _ablation(arguments.fitted_on, arguments.method, options, shipped)
    for setting in settings(protocol, drives):
        if not more or setting.added == drives:
            _print(worlds, setting, protocol, scores, shipped, more)


def _term(column: int, shipped: ConfidenceConfig) -> Score:
    return lambda evidence: -terms_of(evidence, shipped)[:, column]


def _ablation(protocol: str, method: str, options: Options, shipped: ConfidenceConfig) -> dict[str, Score]:
    """The model fitted without one of its terms."""
    made = read_protocol(protocol)
    _, worlds = embed(made, method, options)
    kinds = settings(made, max(len(drives) for drives in worlds.values()))
    sets = [joined(list(open_sets_of(worlds, kind, made.tolerance_m))) for kind in kinds]
    terms = np.concatenate([terms_of(evidence, shipped) for evidence, _ in sets])
    right = np.concatenate([right for _, right in sets])
    weights = np.concatenate([np.full(len(right), 1.0 / len(right)) for _, right in sets])
    without: dict[str, Score] = {}
    for column, name in enumerate(TERMS):
        kept = terms.copy()
        kept[:, column] = 0.0
        fitted = fit_confidence(kept, right, weights, shipped)
        without[f'without {name}'] = lambda evidence, fitted=fitted: log_odds(evidence, fitted)  # type: ignore[misc]
    return without


def _print(
    worlds: Embedded,
    setting: Setting,
    protocol: Protocol,
    scores: dict[str, Score],
    shipped: ConfidenceConfig,
    more: list[list[EmbeddedDrive]],
) -> None:
    sets = list(open_sets_of(worlds, setting, protocol.tolerance_m, more))
    for group in dict.fromkeys(one.group for one in sets):
        some = [one for one in sets if one.group == group]
        evidence, right = joined(some)
        on_map = np.concatenate([one.on_map for one in some])
        # Both halves of a map are searched by the same drive, one after the other.
        pairs = np.repeat(np.arange(len(some)) // 2, [len(one.right) for one in some])
        places = round(float(np.median([one.places for one in some])))
        print(f'\n{group}, {setting}: {len(right)} queries, {places} places, {on_map.mean():.2f} of them on the map')
        print(f'Recall@1 {right[on_map].mean():.3f}; {_gate(some, evidence, right, on_map, shipped)}\n')
        print('| confidence | AUROC | ' + ' | '.join(f'at precision {p:g}' for p in PRECISIONS) + ' | off-map at .99 |')
        print('|---' * (len(PRECISIONS) + 3) + '|')
        for name, score in scores.items():
            found = confidence_figures(score(evidence), right, on_map, pairs, protocol)
            kept = ' | '.join(f'{at.right_kept:.3f}' for at in found.at_precision)
            print(f'| {name} | {found.auroc.value:.4f} | {kept} | {found.at_precision[1].off_map_answered:.4f} |')


def _gate(
    some: list[OpenSet],
    evidence: EvidenceTable,
    right: NDArray[np.bool_],
    on_map: NDArray[np.bool_],
    shipped: ConfidenceConfig,
) -> str:
    p_right, least = probability(evidence, shipped), QueryConfig().min_probability
    clean = ~np.concatenate([one.degraded for one in some])
    found = gate_figures('p_right', least, p_right >= least, right, on_map, clean)
    return (
        f'ECE {expected_calibration_error(p_right, right):.3f}; the default gate answers {found.answered_on_map:.3f} '
        f'on the map ({found.answered_on_map_clean:.3f} of clean scans), {found.answered_off_map:.4f} off it, and '
        f'{found.wrong:.4f} of its answers are wrong'
    )


if __name__ == '__main__':
    main()
