"""`offradar card`: the model card of weights, from the results that were measured with them."""

import json
from pathlib import Path
from typing import Annotated

import typer

from offradar_ros.encoders.model_files import require_package, write_atomically
from offradar_ros.errors import ConfigError
from offradar_ros.lab.evaluation.card import card_json, card_markdown
from offradar_ros.lab.evaluation.results import read_results


def card(
    results: Annotated[Path, typer.Argument(help='results.json of offradar evaluate, with the method ours.')],
    weights: Annotated[Path, typer.Option(help='The weights of that method, safetensors.')],
    out: Annotated[Path, typer.Option(help='Card for programs, NAME.card.json; NAME.md is written beside it.')],
    training: Annotated[Path | None, typer.Option(help='Folder of the training run, with its config.yaml.')] = None,
) -> None:
    """Write the card of trained weights: every figure is one of the results."""
    name = out.name.removesuffix('.card.json')
    if name in ('', out.name):
        raise ConfigError(f'--out {out}: expected a name that ends in .card.json')
    told = read_results(results)
    figures = card_json(told)
    require_package('safetensors', weights)
    from offradar_ros.encoders.weights import read_header  # noqa: PLC0415

    text = card_markdown(name, told, weights, read_header(weights).fingerprint, training)
    markdown = out.with_name(f'{name}.md')
    write_atomically(out, (json.dumps(figures, indent=1, allow_nan=False) + '\n').encode())
    write_atomically(markdown, text.encode())
    typer.echo(f'{out} and {markdown}: written')
