"""Check whether results reach the targets of the weights that ship: see README.md."""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from offradar_ros.errors import OffradarError
from offradar_ros.lab.evaluation.results.file import read_results
from offradar_ros.lab.evaluation.results.results import Results
from offradar_ros.lab.evaluation.table import number
from offradar_ros.records import read_record

TARGETS = Path(__file__).with_name('targets.yaml')


@dataclasses.dataclass(frozen=True)
class Targets:
    """The content of targets.yaml, which explains it."""

    method: str
    recall_at_1_clean: float
    auroc_wrong: float
    rejected_shares: tuple[float, ...]
    uncertain_methods: tuple[str, ...]
    spearman_severity: float
    spearman_severity_of_a_kind: float


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One target in one group and map spacing: `found` must reach `wanted`, or exceed it if `strict`."""

    target: int
    text: str
    group: str
    spacing: str
    wanted: float
    found: float
    strict: bool = False

    @property
    def reached(self) -> bool:
        """Whether the target is reached; NaN does not reach it."""
        return self.found > self.wanted if self.strict else self.found >= self.wanted

    def cells(self) -> list[str]:
        """A row of the table."""
        where = f'{self.group} {self.spacing} m' if self.spacing else self.group
        wanted = f'{">" if self.strict else "≥"} {number(self.wanted)}'
        reached = 'reached' if self.reached else '**missed**'
        return [str(self.target), self.text, where, wanted, number(self.found), reached]


def outcomes(results: Results, targets: Targets) -> Iterator[Outcome]:
    """Every target that the results have figures for; none without the method."""
    if targets.method in results.methods:
        yield from _recall(results, targets)
        yield from _rejection(results, targets)
        yield from _maintenance(results, targets)
        yield from _severity(results, targets)
        yield from _recorded(results, targets)


def _recall(results: Results, targets: Targets) -> Iterator[Outcome]:
    for group, spacings in results.groups.items():
        for place, (spacing, methods) in enumerate(spacings.items()):
            own = methods[targets.method]
            for name, figures in methods.items():
                if name != targets.method:
                    text = f'Recall@1 at least that of {name}'
                    yield Outcome(1, text, group, spacing, figures.recall_at_1.value, own.recall_at_1.value)
            if place == 0:
                found = own.recall_at_1_clean.value
                yield Outcome(1, 'Recall@1 of clean scans', group, spacing, targets.recall_at_1_clean, found)


def _rejection(results: Results, targets: Targets) -> Iterator[Outcome]:
    for group, spacings in results.groups.items():
        for spacing, methods in spacings.items():
            own = methods[targets.method]
            found = own.auroc_wrong.value
            yield Outcome(2, 'AUROC of U for wrong answers', group, spacing, targets.auroc_wrong, found)
            curve = {round(rejected, 6): recall for rejected, recall in own.recall_at_rejection}
            steps = [curve[share] for share in targets.rejected_shares if share in curve]
            # Recall cannot rise above 1.
            gains = [math.inf if high == 1.0 else high - low for low, high in itertools.pairwise(steps)]
            text = f'Recall@RR rises at every step up to {max(targets.rejected_shares):g}'
            yield Outcome(2, text, group, spacing, 0.0, min(gains, default=math.nan), strict=True)
            area = own.auc_recall_at_rejection.value
            for name in targets.uncertain_methods:
                if name in methods:
                    text = f'area under Recall@RR above that of {name}'
                    wanted = methods[name].auc_recall_at_rejection.value
                    yield Outcome(2, text, group, spacing, wanted, area, strict=True)


def _maintenance(results: Results, targets: Targets) -> Iterator[Outcome]:
    for group, spacings in results.maintenance.items():
        for spacing, methods in spacings.items():
            if targets.method in methods:
                recall = methods[targets.method].recall_at_1
                for better, worse in (('M', 'O'), ('M', 'M_random'), ('QM', 'Q')):
                    yield Outcome(3, f'{better} above {worse}', group, spacing, recall[worse], recall[better], True)


def _severity(results: Results, targets: Targets) -> Iterator[Outcome]:
    for group, methods in results.uncertainty.items():
        for kind, found in methods[targets.method].spearman_severity.items():
            wanted = targets.spearman_severity if kind == 'all' else targets.spearman_severity_of_a_kind
            text = f'Spearman of U with severity, {"all scans" if kind == "all" else kind}'
            yield Outcome(4, text, group, '', wanted, found)


def _recorded(results: Results, targets: Targets) -> Iterator[Outcome]:
    conditions = results.recorded.methods[targets.method] if results.recorded else {}
    for name, figures in conditions.items():
        if name != 'clean':
            text = f'mean U of recorded scans: {name} above clean'
            yield Outcome(5, text, '', '', conditions['clean'].mean, figures.mean, strict=True)


def main(words: Sequence[str] | None = None) -> int:
    """Print a Markdown table; exit status 1 if a target is missed or there is none."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('results', type=Path, help='results.json of offradar evaluate')
    parser.add_argument('--targets', type=Path, default=TARGETS)
    arguments = parser.parse_args(words)
    try:
        found = list(outcomes(read_results(arguments.results), read_record(Targets, arguments.targets)))
    except OffradarError as error:
        print(error, file=sys.stderr)
        return 1
    print('|  | what | where | wanted | found |  |\n| --- | --- | --- | --- | --- | --- |')
    for outcome in found:
        print('| ' + ' | '.join(outcome.cells()) + ' |')
    reached = sum(outcome.reached for outcome in found)
    print(f'\n{reached} of {len(found)} reached')
    return 0 if found and reached == len(found) else 1


if __name__ == '__main__':
    sys.exit(main())
