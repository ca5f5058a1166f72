"""A report as files: one self-contained HTML page, Markdown with pictures in a folder, a CSV file for each table."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterator
from pathlib import Path

from offradar_ros.encoders.model_files import write_atomically
from offradar_ros.errors import DataError
from offradar_ros.lab.report.sections import Report, TableSection

PAGE, MARKDOWN = 'report.html', 'report.md'
TEMPLATE = Path(__file__).with_name('page.html.jinja')


def write_report(report: Report, folder: Path) -> list[Path]:
    """Write the page, the Markdown, ``tables/NAME.csv`` and ``figures/NAME.png`` into `folder`.

    Files of an earlier report are replaced. The paths of all files; DataError if the folder cannot be made.
    """
    contents: dict[str, bytes] = {
        PAGE: page(report).encode(),
        MARKDOWN: markdown(report).encode(),
        **{f'tables/{table.name}.csv': comma_separated(table).encode() for table in report.tables},
        **{f'figures/{figure.name}.png': figure.png for figure in report.figures},
    }
    try:
        for inner, ending in (('tables', 'csv'), ('figures', 'png')):
            (folder / inner).mkdir(parents=True, exist_ok=True)
            for stale in (folder / inner).glob(f'*.{ending}'):
                stale.unlink()
    except OSError as error:
        raise DataError(f'{folder}: expected a folder for the report ({error.strerror})') from None
    for name, content in contents.items():
        write_atomically(folder / name, content)
    return [folder / name for name in contents]


def page(report: Report) -> str:
    """HTML that contains its pictures, loads nothing and runs no script."""
    import jinja2  # noqa: PLC0415

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(TEMPLATE.read_text(encoding='utf-8'))
    return template.render(report=report, base64=lambda content: base64.b64encode(content).decode())


def markdown(report: Report) -> str:
    """The report as Markdown; its pictures are in ``figures/``."""
    parts = [f'# {report.title}', '\n'.join(f'* {remark}' for remark in report.remarks)]
    for table in report.tables:
        lines = [table.head, ('---',) * len(table.head), *_marked(table)]
        text = '\n'.join('| ' + ' | '.join(cell.replace('|', '\\|') for cell in line) + ' |' for line in lines)
        parts += [f'## {table.title}', text, table.caption]
    for figure in report.figures:
        parts += [f'## {figure.title}', f'![{figure.alternative}](figures/{figure.name}.png)', figure.caption]
    parts += ['## How it was made', f'```\n{report.command}\n```', report.versions]
    return '\n\n'.join(parts) + '\n'


def _marked(table: TableSection) -> Iterator[list[str]]:
    for at, row in enumerate(table.rows):
        marks = ['**' if (at, k) in table.best else '_' if (at, k) in table.second else '' for k in range(len(row))]
        yield [f'{mark}{cell}{mark}' for mark, cell in zip(marks, row, strict=True)]


def comma_separated(table: TableSection) -> str:
    """A table as CSV."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator='\n')
    writer.writerow(table.head)
    writer.writerows(table.rows)
    return file.getvalue()
