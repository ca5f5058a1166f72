"""Check of a folder of several sequences: each of them, and all of them together."""

from pathlib import Path
from typing import NamedTuple, Optional

from offradar_ros.cli.joint_progress import Shares, joint_progress, share_reporter
from offradar_ros.cli.progress import progress_bar
from offradar_ros.config import PositionConfig, RadarConfig
from offradar_ros.errors import OffradarError
from offradar_ros.processes import parallel_map
from offradar_ros.recordings.bags.topics import ChosenTopics
from offradar_ros.recordings.check import check_recording
from offradar_ros.recordings.datasets.check.alignment import check_alignment
from offradar_ros.recordings.datasets.check.findings import Finding, Findings, note, problem
from offradar_ros.recordings.datasets.check.scan_positions import ScanPositions, no_positions, scan_positions
from offradar_ros.recordings.datasets.check.split import check_split
from offradar_ros.recordings.datasets.splits import Split
from offradar_ros.recordings.source import folders_in, open_source

Section = tuple[str, tuple[Finding, ...]]
"""A heading and what was found under it."""


class CheckOptions(NamedTuple):
    """Options of `offradar check` that apply to each sequence."""

    layout: str
    radar: RadarConfig
    position: PositionConfig
    sample: int
    topics: ChosenTopics


def check_set(
    root: Path,
    sequences: list[Path],
    options: CheckOptions,
    split: Optional[Split],
    processes: int,
) -> list[Section]:
    """A section for each sequence, by `processes` (0: one a core), then one across them and one about the split."""
    with (
        progress_bar(f'checking {root.name}') as progress,
        joint_progress(progress, len(sequences)) as shares,
    ):
        checked = parallel_map(_checked, [(folder, options, shares) for folder in sequences], processes)
    sections = [(folder.name, found.findings) for folder, (found, _) in zip(sequences, checked, strict=True)]
    places = [where for _, where in checked]
    ignored = [folder.name for folder in folders_in(root) if folder not in sequences]
    across = [note(f'no radar scans recognised in {", ".join(ignored)}')] if ignored else []
    sections.append((f'all {len(sequences)} sequences', (*across, *check_alignment(places))))
    if split is not None:
        sections.append((f'split {split.name}', tuple(check_split(split, places))))
    return sections


def _checked(path: Path, options: CheckOptions, shares: Shares) -> tuple[Findings, ScanPositions]:
    """Check one sequence; if it cannot be opened, that is a finding."""
    try:
        found = check_recording(
            path,
            options.layout,
            radar=options.radar,
            position=options.position,
            topics=options.topics,
            sample=options.sample,
            progress=share_reporter(shares),
        )
    except OffradarError as error:
        return Findings(path, '', (problem(str(error)),)), no_positions(path.name)
    try:
        sequence = open_source(path, options.layout, options.radar, options.topics)
        return found, scan_positions(path.name, sequence, options.position.max_gap_s)
    except OffradarError:
        return found, no_positions(path.name)
