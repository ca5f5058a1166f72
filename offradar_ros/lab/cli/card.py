"""`offradar card`: the model card of weights, from results of an evaluation."""

import dataclasses
import shlex
import sys
from pathlib import Path
from typing import Annotated, Optional

import typer

from offradar_ros.bounded_input import read_text
from offradar_ros.encoders.model_files import require_package
from offradar_ros.errors import ConfigError, DataError
from offradar_ros.lab.evaluation.card.card import Card
from offradar_ros.lab.evaluation.card.file import ENDING, card_name, read_card, write_card
from offradar_ros.lab.evaluation.card.make import CardSources, make_card, require_ours, with_open_set
from offradar_ros.lab.evaluation.results.file import read_results


def card(
    source: Annotated[
        Path,
        typer.Argument(
            help='results.json of offradar evaluate, with the method ours; or a card, NAME.card.json, to rewrite.'
        ),
    ],
    weights: Annotated[Optional[Path], typer.Option(help='The weights of that method, safetensors.')] = None,
    out: Annotated[
        Optional[Path], typer.Option(help='Card for programs, NAME.card.json; NAME.md is written next to it.')
    ] = None,
    training: Annotated[Optional[Path], typer.Option(help='Folder of the training run, with its config.yaml.')] = None,
    remarks: Annotated[Optional[Path], typer.Option(help='Markdown for the card: intended use, limits.')] = None,
    open_set: Annotated[
        Optional[Path],
        typer.Option(help='Other results of the same weights, of maps of which a part is left out (held_out_open).'),
    ] = None,
) -> None:
    """Write the model card of trained weights from the results of an evaluation."""
    text = '' if remarks is None else _remarks(remarks)
    if source.name.endswith(ENDING):
        if weights or training:
            raise ConfigError('--weights, --training: expected only with results: a card contains both')
        out = out or source
        made = _renamed(source, out, text)
    else:
        if weights is None or out is None:
            raise ConfigError(f'--weights, --out: expected both, for a card of {source}')
        made = _made(source, weights, CardSources(card_name(out), weights, '', _command(), text, training))
    if open_set is not None:
        made = with_open_set(made, read_results(open_set))
    typer.echo(f'{out} and {write_card(out, made)}: written')


def _renamed(source: Path, out: Path, remarks: str) -> Card:
    found = read_card(source)
    return dataclasses.replace(found, name=card_name(out), remarks=remarks or found.remarks)


def _made(source: Path, weights: Path, sources: CardSources) -> Card:
    results = read_results(source)
    require_ours(results)
    require_package('safetensors', weights)
    from offradar_ros.encoders.weights import read_header  # noqa: PLC0415

    return make_card(results, dataclasses.replace(sources, fingerprint=read_header(weights).fingerprint))


def _remarks(path: Path) -> str:
    try:
        return read_text(path).strip()
    except (OSError, ValueError) as error:
        raise DataError(f'{path}: expected the remarks of a card, Markdown ({error})') from None


def _command() -> str:
    return shlex.join(['offradar', *sys.argv[1:]])
