"""Figures of U for variants of the training, one line each: see README.md."""

from __future__ import annotations

import argparse
from pathlib import Path

from offradar_ros.cli.progress import progress_bar
from offradar_ros.lab.evaluation.methods import open_method
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.lab.evaluation.results.arrays import map_arrays, scan_rows
from offradar_ros.lab.evaluation.results.assemble import assemble
from offradar_ros.lab.evaluation.results.results import Results
from offradar_ros.lab.evaluation.runner import drives_by_world, measure
from offradar_ros.lab.evaluation.simulated_drives import simulated_drives

REJECTIONS = (0.0, 0.1, 0.2, 0.3, 0.5)


def main() -> None:
    """Print a Markdown table for each group of the protocol, and for all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('protocol', type=Path)
    parser.add_argument('variants', nargs='+', metavar='METHOD', help='as --method of offradar evaluate')
    parser.add_argument('--cache', type=Path, required=True, help='folder of simulated scans and embeddings, kept')
    parser.add_argument('--streets', type=Path, help='folder of the maps and traversals that the protocol names')
    parser.add_argument('--threads', type=int, default=0)
    arguments = parser.parse_args()
    protocol, cache = read_protocol(arguments.protocol), arguments.cache
    worlds = drives_by_world(list(simulated_drives(protocol, arguments.streets)), [], cache, progress_bar)
    measured = []
    for text in arguments.variants:
        spacing_m = protocol.map_spacings_m[0]
        method = open_method(text, cache, seed=protocol.seed, spacing_m=spacing_m, threads=arguments.threads)
        measured.append(measure(method, worlds, protocol, cache, progress_bar))
    results = assemble(measured, worlds, protocol, scan_rows(measured, worlds), map_arrays(measured))
    for group in results.groups:
        print(f'\n{group}\n\n' + '\n'.join(table(results, group)))


def table(results: Results, group: str) -> list[str]:
    """Lines of Markdown; Recall@RR, AUROC and correlations are of the first map spacing."""
    spacings = results.groups[group]
    first = next(iter(spacings.values()))
    heads = [f'Recall@1, {spacing} m (clean)' for spacing in spacings]
    heads += ['U: mean, range', 'Spearman U–severity', 'Spearman U–correct', 'AUROC', f'Recall@RR {REJECTIONS}']
    lines = ['| variant | ' + ' | '.join(heads) + ' |', '|---' * (len(heads) + 1) + '|']
    for name, figures in first.items():
        uncertainty = results.uncertainty[group][name]
        curve = dict(figures.recall_at_rejection)
        cells = [
            f'{methods[name].recall_at_1.value:.3f} ({methods[name].recall_at_1_clean.value:.3f})'
            for methods in spacings.values()
        ]
        cells += [
            f'{uncertainty.mean:.3g}, {uncertainty.least:.3g}–{uncertainty.greatest:.3g}',
            f'{uncertainty.spearman_severity["all"]:.3f}',
            f'{figures.spearman_correct:.3f}',
            f'{figures.auroc_wrong.value:.3f}',
            ' '.join(f'{curve[rejected]:.3f}' for rejected in REJECTIONS if rejected in curve),
        ]
        lines.append(f'| {name} | ' + ' | '.join(cells) + ' |')
    return lines


if __name__ == '__main__':
    main()
