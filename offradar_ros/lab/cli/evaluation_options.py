"""Options that `offradar evaluate` and `offradar encode` share."""

import dataclasses
from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.errors import ConfigError
from offradar_ros.lab.evaluation.methods import METHODS
from offradar_ros.lab.evaluation.protocol import Group, Protocol, Recorded
from offradar_ros.lab.evaluation.protocol_file import read_protocol
from offradar_ros.recordings.source import require_recording

METHODS_HELP = (
    f'NAME is {", ".join(METHODS)}, or an encoder of an installed package. WEIGHTS is a file, the folder of a training '
    'run or the name of weights that ship; ring_key has none, and rad_vlad is fitted to each map without them. '
    'LABEL=NAME:WEIGHTS is a variant, named LABEL in results. May be repeated; ours=compact and ring_key if not given.'
)
DEFAULT_METHODS = ('ring_key', 'ours=compact')

ProtocolName = Annotated[
    Optional[str],
    typer.Argument(
        help='Protocol: a YAML file, or the name of one that ships; simulated if not given, or own with --map.'
    ),
]
Methods = Annotated[Optional[list[str]], typer.Option('--method', metavar='NAME[=WEIGHTS]', help=METHODS_HELP)]
Data = Annotated[Optional[Path], typer.Option(help='Folder of the recorded sequences that the protocol names.')]
Maps = Annotated[
    Optional[list[Path]],
    typer.Option(
        '--map',
        help='A recording of your own that is mapped, in place of the drives of the protocol; for M the other '
        'recordings are merged into its map.',
    ),
]
Queries = Annotated[
    Optional[list[Path]], typer.Option('--query', help='A recording of your own that is searched for in the maps.')
]
ExclusionS = Annotated[
    Optional[float],
    typer.Option(
        min=0.0,
        help='Above 0: drives are also searched for in their own maps, without places scanned within these seconds.',
    ),
]
LeaveOutM = Annotated[
    Optional[float],
    typer.Option(
        min=0.0,
        help='Above 0: of each map, stretches of this many metres are left out by turns, so that queries there are off '
        'the map.',
    ),
]
Params = Annotated[
    Optional[Path],
    typer.Option(
        help='Parameter file: how recordings are read, the encoder, and the threshold in use where it has one.'
    ),
]
Streets = Annotated[
    Optional[Path], typer.Option(help='Folder of the nav2 maps and recorded traversals that the protocol names.')
]
Processes = Annotated[int, typer.Option(min=0, help='Processes that simulate; 0 for one per core.')]
Threads = Annotated[int, typer.Option(min=0, help='Threads of a learned encoder; 0 for one per core.')]


def print_note(note: str) -> None:
    """Print a note of an evaluation."""
    typer.echo(f'note: {note}')


def protocol_of(
    name: str | None,
    maps: list[Path] | None,
    queries: list[Path] | None,
    exclusion_s: float | None = None,
    leave_out_m: float | None = None,
) -> Protocol:
    """The protocol of a name, with the given recordings in place of its drives, if any are given.

    A recording that is both mapped and searched for is also searched for in its own map. Simulated validation drives
    are dropped, because U has another scale with another radar. ConfigError if the options do not fit each other.
    """
    given = bool(maps or queries)
    protocol = read_protocol(name or ('own' if given else 'simulated'))
    if exclusion_s is not None:
        protocol = dataclasses.replace(protocol, exclusion_s=exclusion_s)
    if leave_out_m is not None:
        protocol = dataclasses.replace(protocol, leave_out='', leave_out_m=leave_out_m)
    if not given and protocol.groups:
        return protocol
    if not maps or not queries:
        raise ConfigError(f'protocol {protocol.name}: expected at least one --map and one --query')
    for path in (*maps, *queries):
        require_recording(path, 'auto')
    mapped, searched = (list(dict.fromkeys(str(path.resolve()) for path in paths)) for paths in (maps, queries))
    both = [path for path in mapped if path in searched]
    if both and not protocol.exclusion_s > 0.0:
        raise ConfigError(f'{both[0]}: is searched for in its own map: expected --exclusion-s above 0')
    road = Recorded(
        'own',
        sequences=tuple(both),
        maps=tuple(path for path in mapped if path not in both),
        queries=tuple(path for path in searched if path not in both),
    )
    return dataclasses.replace(
        protocol,
        title='Own recordings',
        groups=(Group('own', 'Own recordings', recorded=(road,)),),
        validation=dataclasses.replace(protocol.validation, cities=()),
    )
