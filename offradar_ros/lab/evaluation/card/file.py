"""The two files of a card: NAME.card.json for programs, NAME.md for readers."""

from __future__ import annotations

from pathlib import Path

from offradar_ros.encoders.model_files import write_atomically
from offradar_ros.errors import ConfigError
from offradar_ros.lab.evaluation.card.card import Card
from offradar_ros.lab.evaluation.card.markdown import card_markdown
from offradar_ros.lab.evaluation.stored_record import StoredFormat

ENDING = '.card.json'

FORMAT = StoredFormat(
    Card,
    kind='offradar-card',
    number=1,
    description='a card of offradar card, NAME.card.json',
    remedy='make it again from the results: offradar card RESULTS',
)


def card_name(path: Path) -> str:
    """NAME of NAME.card.json; ConfigError for another file name."""
    name = path.name.removesuffix(ENDING)
    if name in ('', path.name):
        raise ConfigError(f'{path}: expected a name that ends in {ENDING}')
    return name


def write_card(path: Path, card: Card) -> Path:
    """Write both files and return the path of the Markdown. ModelError where they cannot be written."""
    markdown = path.with_name(f'{card_name(path)}.md')
    FORMAT.write(path, card)
    write_atomically(markdown, card_markdown(card).encode())
    return markdown


def read_card(path: Path) -> Card:
    """The card in a file of `write_card`; DataError for another file."""
    return FORMAT.read(path)
