"""Plot the results of search.py: cost against the size of the map and against top-k."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use('Agg')
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

COLOUR = '#1f5fa8'
K = '5'


def draw(results: dict[str, Any], path: Path) -> None:
    """Draw two panels into a PNG file."""
    figure, (by_size, by_k) = plt.subplots(1, 2, figsize=(11.5, 4.6), width_ratios=(1.35, 1))
    _against_size(by_size, results)
    _against_k(by_k, results)
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _against_size(axes: Axes, results: dict[str, Any]) -> None:
    sizes = results['search']['sizes']
    largest = max(sizes, key=int)
    places = [int(size) for size in sizes]
    _curve(axes, places, [sizes[size]['queries'][K] for size in sizes], f'query, k = {K}')
    speed = sizes[largest]['reading']['gb_s'] * 1e6
    floor = [sizes[size]['matrix_bytes'] / speed for size in sizes]
    axes.plot(places, floor, '--', color=COLOUR, linewidth=1.2, label=f'reading the map at {speed / 1e6:.1f} GB/s')
    floor = [sizes[size]['flop_floor_ms'] for size in sizes]
    axes.plot(places, floor, ':', color='0.35', label=f'2·N·d at {results["search"]["peak_gflops"]:.0f} GFLOP/s')
    merges = results['merge']
    for kind, marker in {'inserted': '^', 'replaced': 's', 'kept': 'v'}.items():
        medians = [merges[size][kind]['median_ms'] for size in sizes]
        axes.plot(places, medians, marker=marker, color='0.55', linewidth=0.8, markersize=4, label=f'merge: {kind}')
    axes.set(xscale='log', yscale='log', xlabel='places in the map (d = 128)', ylabel='milliseconds, one thread')
    axes.grid(True, which='major', alpha=0.3)
    axes.legend(fontsize=8, loc='upper left')


def _against_k(axes: Axes, results: dict[str, Any]) -> None:
    sizes = results['search']['sizes']
    largest = max(sizes, key=int)
    queries = sizes[largest]['queries']
    _curve(axes, [int(k) for k in queries], list(queries.values()), 'query')
    read_ms = sizes[largest]['reading']['median_ms']
    axes.axhline(read_ms, linestyle='--', color=COLOUR, linewidth=1.2, label='reading the map once')
    axes.axhline(sizes[largest]['flop_floor_ms'], linestyle=':', color='0.35', label='2·N·d at the peak of a core')
    axes.set(xscale='log', xlabel=f'top-k, {int(largest):,} places', ylabel='milliseconds, one thread')
    axes.set_ylim(bottom=0.0)
    axes.grid(True, which='major', alpha=0.3)
    axes.legend(fontsize=8, loc='lower right', bbox_to_anchor=(1.0, 0.06))


def _curve(axes: Axes, x: list[int], timings: list[dict[str, Any]], label: str) -> None:
    low, high = zip(*(timing['quartiles_ms'] for timing in timings), strict=True)
    axes.fill_between(x, low, high, color=COLOUR, alpha=0.2, linewidth=0)
    axes.plot(x, [timing['median_ms'] for timing in timings], marker='o', color=COLOUR, markersize=4, label=label)
