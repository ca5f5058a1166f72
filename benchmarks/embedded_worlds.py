"""What benchmarks over the worlds of a protocol share: their arguments, and the embedded drives that these name."""

from __future__ import annotations

import argparse
from pathlib import Path

from offradar_ros.cli.progress import progress_bar
from offradar_ros.lab.evaluation.evaluate import Options


def worlds_parser(description: str | None) -> argparse.ArgumentParser:
    """A parser of the protocol, the method, the cache and the streets."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('protocol')
    parser.add_argument('--method', default='ours=compact')
    parser.add_argument('--cache', type=Path, required=True, help='folder of simulated scans and embeddings, kept')
    parser.add_argument('--streets', type=Path, help='folder of the maps and traversals that the protocol names')
    return parser


def options_of(arguments: argparse.Namespace) -> Options:
    """The options of an evaluation, from the arguments of `worlds_parser`."""
    return Options(arguments.cache, arguments.cache, '', progress_bar, arguments.streets)
