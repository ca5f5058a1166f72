"""Campaigns of faults against files, records, messages and running nodes: see README.md.

Exit status 1 if one of them ended a process, changed something silently, or lost something.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from faults import flipped_files, kills, live_messages, moved_files, mutated_records, power_cuts, soak
from faults.page import read_record, write_tables
from faults.result import Result, Settings
from measuring import single_threaded, write_results

CAMPAIGNS: dict[str, Callable[[Settings], list[Result]]] = {
    module.NAME: module.run
    for module in (flipped_files, mutated_records, kills, power_cuts, moved_files, live_messages, soak)
}
SEED = 1
SOAK_S = 60.0


def main() -> int:
    """Run the campaigns that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--only', nargs='+', choices=CAMPAIGNS, default=list(CAMPAIGNS), metavar='NAME')
    parser.add_argument('--scale', type=float, default=1.0, help='share of the full number of tries')
    parser.add_argument('--seed', type=int, default=SEED, help='of every random choice')
    parser.add_argument('--soak', type=float, metavar='HOURS', help='length of the soak, instead of a minute')
    parser.add_argument('--out', type=Path, metavar='JSON', help='write the results there')
    parser.add_argument('--page', type=Path, metavar='MARKDOWN', help='replace the tables of this page')
    arguments = parser.parse_args()
    if arguments.page and not arguments.out:
        parser.error('--page: needs --out, from which its tables are made')
    # A try is short: threads of BLAS would wait for one another, and a process that forks should have none.
    single_threaded()
    soak_s = SOAK_S if arguments.soak is None else 3600.0 * arguments.soak
    results = campaigns(arguments.only, arguments.seed, arguments.scale, soak_s)
    if arguments.out:
        values = {'scale': arguments.scale, 'results': [dataclasses.asdict(result) for result in results]}
        write_results(arguments.out, values, {'faults': arguments.seed})
    if arguments.page:
        write_tables(arguments.page, read_record(arguments.out))
    failed = [result for result in results if result.failures]
    for result in failed:
        print(f'{result.campaign}: {result.kind}: {result.failures} failures of {result.tries} tries', file=sys.stderr)
        for example in result.examples:
            print(f'  {example}', file=sys.stderr)
    return 1 if failed else 0


def campaigns(names: list[str], seed: int, scale: float, soak_s: float) -> list[Result]:
    """The results of these campaigns, which are printed as they come."""
    found: list[Result] = []
    for name in names:
        print(f'{name}: seed {seed}', flush=True)
        started_s = time.monotonic()
        with tempfile.TemporaryDirectory(prefix='offradar_faults_') as folder:
            for result in CAMPAIGNS[name](Settings(Path(folder), seed, scale, soak_s)):
                print(
                    f'  {result.kind}: {result.tries} tries, {result.refused} refused, {result.same} as it should be, '
                    f'{result.differences} different, {result.crashes} crashed, {result.losses} lost',
                    flush=True,
                )
                found.append(result)
        print(f'  {time.monotonic() - started_s:.0f} s', flush=True)
    return found


if __name__ == '__main__':
    sys.exit(main())
