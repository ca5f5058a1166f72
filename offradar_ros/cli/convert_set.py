"""Conversion of several recordings, each to a bag, by several processes; it continues an earlier run."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Union

from offradar_ros.cli.conversion import Conversion, convert_sequence
from offradar_ros.cli.joint_progress import Shares, joint_progress, share_reporter
from offradar_ros.config import RadarConfig
from offradar_ros.errors import OffradarError
from offradar_ros.processes import parallel_map
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.bags.writer import BagOptions
from offradar_ros.recordings.source import open_source

Outcome = Union[Conversion, str, None]
"""The report, the error, or None for a bag that exists already."""


class ConvertOptions(NamedTuple):
    """Options of `offradar convert` that apply to each sequence."""

    layout: str
    topics: ChosenTopics
    bag: BagOptions
    skip_unreadable: bool
    radar: RadarConfig


def convert_set(
    sources: list[Path], out: Path, options: ConvertOptions, processes: int, progress: Callable[[float, float], None]
) -> dict[Path, Outcome]:
    """Convert each of `sources` to the bag OUT/<its name>, by `processes` (0: one for each core).

    A bag appears under its name when it is complete, so an existing one is kept, unless it may be overwritten.
    """
    bags = [out / source.name for source in sources]
    tasks = [
        (source, bag, options)
        for source, bag in zip(sources, bags, strict=True)
        if options.bag.overwrite or not (bag / 'metadata.yaml').is_file()
    ]
    outcomes: dict[Path, Outcome] = dict.fromkeys(bags)
    if tasks:
        with joint_progress(progress, len(tasks)) as shares:
            made = parallel_map(_converted, [(*task, shares) for task in tasks], processes)
        outcomes.update((bag, outcome) for (_, bag, _), outcome in zip(tasks, made, strict=True))
    return outcomes


def _converted(source: Path, bag: Path, options: ConvertOptions, shares: Shares) -> Union[Conversion, str]:
    """The report, or the error: a sequence that cannot be converted does not stop the others."""
    try:
        sequence = open_source(source, options.layout, options.radar, options.topics)
        return convert_sequence(sequence, bag, options.bag, options.skip_unreadable, share_reporter(shares))
    except OffradarError as error:
        return str(error)
