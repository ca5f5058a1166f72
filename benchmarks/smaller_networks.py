"""Speed and recall of networks in 8-bit integers and of low rank: see README.md."""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from measuring import interleaved, previous_results, single_threaded, write_results

from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import RadarConfig
from offradar_ros.encoders.export.calibration_scans import SCANS, CalibrationScans, calibration_scans
from offradar_ros.encoders.export.onnx_export import Compression, export_onnx
from offradar_ros.encoders.onnx_backend import OnnxEncoder
from offradar_ros.encoders.weights import read_header
from offradar_ros.lab.drives.cache import cached_drives
from offradar_ros.lab.drives.drive import Drive
from offradar_ros.lab.evaluation.answers import Pair, Rules, search_drive_map
from offradar_ros.lab.evaluation.embedding_cache import EmbeddedDrive, cached_embeddings
from offradar_ros.lab.evaluation.metrics.recall_at_n import recall_at_n
from offradar_ros.lab.evaluation.metrics.spearman import spearman
from offradar_ros.lab.evaluation.protocol import VALIDATION, Protocol
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.lab.evaluation.simulated_drives import city_drive, simulated_drives
from offradar_ros.recordings.source import open_source
from offradar_ros.sequence import RadarSequence
from offradar_ros.types import PolarScan

PROJECT = Path(__file__).resolve().parents[1]
RESULTS = PROJECT / 'benchmarks' / 'results' / 'smaller_networks.json'
PICTURE = PROJECT / 'docs' / 'speed_against_recall.png'
CALIBRATION_CITIES = (2595001, 2595002)
CALIBRATION_SCANS = 100
SHARES = (0.75, 0.5, 0.35)
THREADS = (1, 2)
WARM_UP = 2
SCANS_TIMED = 20
FLOAT = 'float32'
OTHER_RANGES = ('int8 percentile', 'int8 entropy')
LEAST_SPAN = 1.0
"""Least half-height of the plot in points of recall, so that a difference of a few scans looks small."""

VARIANTS: dict[str, Callable[[CalibrationScans], Compression | None]] = {
    FLOAT: lambda _: None,
    'int8': lambda scans: Compression(scans, int8=True),
    'int8 percentile': lambda scans: Compression(scans, int8=True, method='percentile'),
    'int8 entropy': lambda scans: Compression(scans, int8=True, method='entropy'),
    **{
        f'low rank {share:g}{" int8" if int8 else ""}': lambda scans, share=share, int8=int8: Compression(  # type: ignore[misc]
            scans, int8=int8, low_rank=share
        )
        for int8, share in itertools.product((False, True), SHARES)
    },
}


class Answered(NamedTuple):
    """The embeddings and recall of one variant of a network."""

    made: list[EmbeddedDrive]
    recall_at_1: float
    queries: int

    @property
    def uncertainties(self) -> Any:
        """(N,) of all scans."""
        return np.concatenate([drive.uncertainties for drive in self.made])

    @property
    def means(self) -> Any:
        """(N, d) of all scans."""
        return np.concatenate([drive.means for drive in self.made])


def main() -> None:
    """Print a table for each network, and write and draw all results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('networks', nargs='*', metavar='NAME=WEIGHTS', help='.safetensors; only draw if not given')
    parser.add_argument('--drive', type=Path, action='append', help='fit to these drives instead of two simulated ones')
    parser.add_argument('--protocol', type=Path, default=PROJECT / 'params' / 'protocols' / 'quick.yaml')
    parser.add_argument(
        '--cache', type=Path, default=PROJECT / 'build' / 'smaller_networks', help='folder of files that are kept'
    )
    parser.add_argument('--scans', type=int, default=SCANS, help='number of scans that a variant is fitted to')
    parser.add_argument('--variants', nargs='+', choices=tuple(VARIANTS), default=tuple(VARIANTS))
    parser.add_argument('--rounds', type=int, default=30, help='timed encodings of each variant; 0 for none')
    parser.add_argument('--out', type=Path, default=RESULTS, help='default: the results in the repository')
    arguments = parser.parse_args()
    if arguments.networks:
        protocol = read_protocol(arguments.protocol)
        for text in arguments.networks:
            read_header(text.partition('=')[2])
        drives, calibration = _drives(protocol, arguments.cache, arguments.drive)
        kept = previous_results(arguments.out)
        networks: dict[str, Any] = dict(kept.get('networks', {}))
        for text in arguments.networks:
            name, _, weights = text.partition('=')
            header = read_header(weights)
            scans = calibration_scans(calibration, header.config, arguments.scans)
            figures = _measured(Path(weights), drives, scans, protocol, arguments)
            networks[name] = {
                'description': header.description,
                'fitted_to': scans.source,
                'protocol': protocol.name,
                'map_spacing_m': protocol.map_spacings_m[0],
                'tolerance_m': protocol.tolerance_m,
                'variants': figures,
            }
            print(f'\n{name}\n\n' + '\n'.join(_table(figures)), flush=True)
        seeds = dict(zip(('first calibration city', 'second calibration city'), CALIBRATION_CITIES, strict=True))
        write_results(arguments.out, {'networks': networks}, seeds, kept)
    _draw(json.loads(arguments.out.read_text(encoding='utf-8')), PICTURE)


def _drives(
    protocol: Protocol, cache: Path, recorded: Sequence[Path] | None
) -> tuple[list[Drive], list[RadarSequence]]:
    """The drives to measure on, and drives of other cities to fit to."""
    measured = [drive.source for drive in simulated_drives(protocol, None) if drive.group != VALIDATION]
    lane, spacing_m, degraded = protocol.lanes[0], protocol.drive_spacing_m, protocol.degraded
    fitted = [
        city_drive(seed, 0, lane, 'drawn', CALIBRATION_SCANS, spacing_m, degraded)
        for seed in ([] if recorded else CALIBRATION_CITIES)
    ]
    with progress_bar('simulating drives') as progress:
        found = cached_drives([*measured, *fitted], cache / 'scans', progress=progress)
    others: list[RadarSequence] = [open_source(path, 'auto', RadarConfig()) for path in recorded or ()]
    return found[: len(measured)], [*found[len(measured) :], *others]


def _measured(
    weights: Path,
    drives: list[Drive],
    scans: CalibrationScans,
    protocol: Protocol,
    arguments: argparse.Namespace,
) -> dict[str, dict[str, Any]]:
    files, answered = {}, {}
    for variant in dict.fromkeys((FLOAT, *arguments.variants)):
        files[variant] = _exported(weights, variant, scans, arguments.cache)
        answered[variant] = _answered(OnnxEncoder(files[variant]), drives, protocol, arguments.cache, variant)
    timed = _timed(files, [drives[0].scan(row) for row in range(SCANS_TIMED)], arguments.rounds)
    exact, figures = answered[FLOAT], {}
    for variant, result in answered.items():
        lengths = np.linalg.norm(result.means, axis=1) * np.linalg.norm(exact.means, axis=1)
        figures[variant] = {
            'recall_at_1': result.recall_at_1,
            'recall_difference_points': 100.0 * (result.recall_at_1 - exact.recall_at_1),
            'queries': result.queries,
            'spearman_u': spearman(result.uncertainties, exact.uncertainties),
            'mean_u': float(result.uncertainties.mean()),
            'mean_cosine': float(((result.means * exact.means).sum(axis=1) / lengths).mean()),
            'megabytes': files[variant].stat().st_size / 1e6,
            'threads': {
                threads: timing | {'ratio_to_float32': timing['median_ms'] / timed[FLOAT][threads]['median_ms']}
                for threads, timing in timed[variant].items()
            },
        }
    return figures


def _exported(weights: Path, variant: str, scans: CalibrationScans, cache: Path) -> Path:
    """The file of a variant, exported now or earlier from the same weights and scans."""
    folder = (
        cache
        / 'networks'
        / f'{read_header(weights).fingerprint[:16]}_{hashlib.sha256(scans.images.tobytes()).hexdigest()[:16]}'
    )
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f'{variant.replace(" ", "_")}.onnx'
    if not path.is_file():
        start_s = time.perf_counter()
        export_onnx(weights, path, VARIANTS[variant](scans))
        print(f'{path.name}: exported in {time.perf_counter() - start_s:.0f} s', flush=True)
    return path


def _answered(encoder: OnnxEncoder, drives: list[Drive], protocol: Protocol, cache: Path, variant: str) -> Answered:
    made = []
    for drive in drives:
        with progress_bar(f'{variant}: {drive.name}') as progress:
            made.append(cached_embeddings(encoder, drive, cache / 'embeddings', progress))
    ranks = []
    for mapped, query in itertools.permutations(made, 2):
        if mapped.drive.world == query.drive.world:
            pair = Pair(
                '',
                mapped.drive.group,
                mapped.drive.world,
                mapped.drive.index,
                query.drive.index,
                protocol.map_spacings_m[0],
            )
            found = search_drive_map(pair, mapped, query, Rules(protocol.tolerance_m, protocol.negative_m))
            ranks.append(found.ranks[found.positive])
    together = np.concatenate(ranks)
    return Answered(made, recall_at_n(together, 1), len(together))


def _timed(files: dict[str, Path], scans: list[PolarScan], rounds: int) -> dict[str, dict[str, dict[str, Any]]]:
    """Timings of encoding a scan, by variant and threads; the variants are called in turn."""
    found: dict[str, dict[str, dict[str, Any]]] = {variant: {} for variant in files}
    for threads in THREADS if rounds else ():
        calls = {variant: _encoding(OnnxEncoder(path, threads), scans) for variant, path in files.items()}
        for variant, timing in interleaved(calls, rounds, WARM_UP).items():
            found[variant][str(threads)] = timing.as_dict()
    return found


def _encoding(encoder: OnnxEncoder, scans: list[PolarScan]) -> Callable[[], object]:
    following = itertools.cycle(scans)
    return lambda: encoder.encode(next(following))


def _table(figures: dict[str, dict[str, Any]]) -> list[str]:
    heads = ['Recall@1', 'points', 'Spearman U', 'mean U', 'cosine', 'MB']
    heads += [f'ms, {threads} thread{"s" * (threads > 1)} (of float32)' for threads in THREADS]
    lines = ['| variant | ' + ' | '.join(heads) + ' |', '|---' * (len(heads) + 1) + '|']
    for variant, row in figures.items():
        cells = [f'{row["recall_at_1"]:.4f}', f'{row["recall_difference_points"]:+.2f}', f'{row["spearman_u"]:.4f}']
        cells += [f'{row["mean_u"]:.3f}', f'{row["mean_cosine"]:.5f}', f'{row["megabytes"]:.1f}']
        cells += [f'{taken["median_ms"]:.1f} ({taken["ratio_to_float32"]:.2f})' for taken in row['threads'].values()]
        lines.append(f'| {variant} | ' + ' | '.join(cells) + ' |')
    return lines


def _machine_label(machine: dict[str, Any]) -> str:
    return f'{machine["processor"]} ({", ".join(machine["integers"]) or "no VNNI"})'


def _draw(report: dict[str, Any], path: Path) -> None:
    """Draw Recall@1 against the time of a scan, a panel for each network; the legend has the rank correlation of U."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    networks = {
        name: figures['variants']
        for name, figures in report['networks'].items()
        if figures['variants'][FLOAT]['threads']
    }
    if not networks:
        print('no timings: no picture is drawn')
        return
    figure = Figure(figsize=(6.5 * len(networks), 4.8), layout='constrained')
    threads = str(THREADS[0])
    for panel, (name, figures) in zip(
        figure.subplots(1, len(networks), squeeze=False)[0], networks.items(), strict=True
    ):
        drawn = {variant: row for variant, row in figures.items() if variant not in OTHER_RANGES}
        colours = {kind: f'C{number}' for number, kind in enumerate(v for v in VARIANTS if 'int8' not in v)}
        for variant, row in drawn.items():
            at = row['threads'][threads]['median_ms'], 100.0 * row['recall_at_1']
            colour = colours.get(variant.removesuffix('int8').strip() or FLOAT, 'black')
            text = f'{variant}, {row["spearman_u"]:.3f}'
            panel.plot(*at, 's' if 'int8' in variant else 'o', color=colour, label=text)
        panel.legend(title='rank correlation of U', fontsize=8, title_fontsize=8)
        panel.set(title=name, xlabel='milliseconds per scan, one thread', ylabel='Recall@1, %')
        recalls = [100.0 * row['recall_at_1'] for row in drawn.values()]
        middle, half = (max(recalls) + min(recalls)) / 2, max(LEAST_SPAN, max(recalls) - min(recalls))
        panel.set_ylim(middle - half, middle + half)
        panel.margins(x=0.25)
        panel.set_xlim(left=0.0)
        panel.grid(alpha=0.3)
    figure.suptitle(
        f'Speed against recall, and the rank correlation of U with that of {FLOAT}\n'
        f'{_machine_label(report["machine"])}',
        fontsize=9,
    )
    figure.savefig(path, dpi=110)
    print(f'{path}: drawn')


if __name__ == '__main__':
    single_threaded()
    main()
