"""Several recordings to a bag each, by several processes, going on where an earlier run ended."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Union

from offradar_ros.cli.conversion import Conversion, convert_sequence
from offradar_ros.cli.joint_progress import Shares, joint_progress, telling
from offradar_ros.config import RadarConfig
from offradar_ros.errors import OffradarError
from offradar_ros.processes import parallel_map
from offradar_ros.recordings.bags.writer import BagOptions
from offradar_ros.recordings.source import open_source

Outcome = Union[Conversion, str, None]
"""What was written, why nothing could be, or None for a bag that is there already."""


class HowToConvert(NamedTuple):
    """Attributes: what applies to each sequence: options of `offradar convert`."""

    layout: str
    options: BagOptions
    skip_unreadable: bool


def convert_set(
    sources: list[Path], out: Path, how: HowToConvert, processes: int, progress: Callable[[float, float], None]
) -> dict[Path, Outcome]:
    """Each of `sources` to the bag OUT/<its name>, by `processes` (0: one a core), and how that went.

    A bag appears under its name when it is complete: one that is there is left as it is, unless it may be overwritten.
    """
    bags = [out / source.name for source in sources]
    begun = [
        (source, bag, how)
        for source, bag in zip(sources, bags, strict=True)
        if how.options.overwrite or not (bag / 'metadata.yaml').is_file()
    ]
    outcomes: dict[Path, Outcome] = dict.fromkeys(bags)
    if begun:
        with joint_progress(progress, len(begun)) as shares:
            made = parallel_map(_converted, [(*task, shares) for task in begun], processes)
        outcomes.update((bag, outcome) for (_, bag, _), outcome in zip(begun, made, strict=True))
    return outcomes


def _converted(source: Path, bag: Path, how: HowToConvert, shares: Shares) -> Union[Conversion, str]:
    """That a sequence cannot be converted stops no other: its error is reported at the end."""
    try:
        sequence = open_source(source, how.layout, RadarConfig())
        return convert_sequence(sequence, bag, how.options, how.skip_unreadable, telling(shares))
    except OffradarError as error:
        return str(error)
