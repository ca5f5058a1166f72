"""The report of a small evaluation: its content, and how a browser shows it."""

from __future__ import annotations

import csv
import dataclasses
import html
import json
import math
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from offradar_ros.cli.main import app
from offradar_ros.errors import DataError
from offradar_ros.lab.evaluation.results.alignments import AlignmentFigures, AnswerFigures, RecallAtPrecision
from offradar_ros.lab.evaluation.results.file import read_results
from offradar_ros.lab.report.alignment_tables import alignment_tables
from offradar_ros.lab.report.paper_tables import PAPER_TABLES
from offradar_ros.lab.report.source import Source, read_source

pytest.importorskip('matplotlib')
jinja2 = pytest.importorskip('jinja2')

PROTOCOL = """
name: tiny
title: 'Tiny <cities> & "streets"'
groups:
  - {name: a, title: A & B, cities: [2999971]}
lanes: [{}, {left_m: 1.0}, {left_m: -1.0}]
scans: 12
validation: {cities: [2999972], scans: 6}
map_spacings_m: [5.0, 15.0]
resamples: 5
"""

BROWSER = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), None)
FLAGS = (
    '--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking '
    '--disable-component-update --disable-sync --enable-logging=stderr --virtual-time-budget=20000 --dump-dom'
)
COUNT_SCRIPT = """<script>
const images = [...document.images];
document.documentElement.setAttribute('data-images', JSON.stringify(
  images.map(image => [image.closest('section').id, image.naturalWidth, image.alt.length > 0])));
if (location.hash) throw new Error('not of the page');
</script>"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('report')
    (folder / 'tiny.yaml').write_text(PROTOCOL)
    for command in (['evaluate', folder / 'tiny.yaml', '--method', 'ring_key', '--out', folder], ['report', folder]):
        done = CliRunner().invoke(app, [str(word) for word in command], catch_exceptions=False)
        assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope='module')
def source(folder: Path) -> Source:
    return read_source(folder)


def rows_of(folder: Path, name: str) -> list[list[str]]:
    with (folder / 'report' / 'tables' / f'{name}.csv').open(newline='') as file:
        return list(csv.reader(file))


def test_the_tables_hold_the_results(folder: Path) -> None:
    results = read_results(folder / 'results.json')
    figures = results.groups['a']['5']['ring_key']
    (head, row) = rows_of(folder, 'recognition_a_5m')
    cells = dict(zip(head, row, strict=True))
    assert cells['method'] == 'RingKey'
    assert cells['R@1 (%)'] == f'{100 * figures.recall_at_1.value:.2f}'
    assert cells['R@1 of all (%)'] == f'{100 * figures.every_query.recall_at_1:.2f}'
    assert cells['F2'] == f'{figures.max_f_beta["2"].value:.3f}'
    assert cells['AP of pairs'] == f'{figures.pair_level.average_precision.value:.3f}'
    (head, row) = rows_of(folder, 'ablation_a_15m')
    assert row[head.index('M')] == f'{100 * results.maintenance["a"]["15"]["ring_key"].recall_at_1["M"]:.2f}'
    thresholds = rows_of(folder, 'thresholds_a_5m')[1:]
    assert 1 <= len(thresholds) <= 21
    assert [row[2] for row in thresholds].count('0') <= 1
    assert [float(row[1]) for row in thresholds] == sorted((float(row[1]) for row in thresholds), reverse=True)


def test_the_poses_are_those_of_the_results(folder: Path) -> None:
    results = read_results(folder / 'results.json')
    found = results.alignments['a']['5']['ring_key']
    # Its coefficients know no score.
    assert found.answers is None
    assert not (folder / 'report' / 'tables' / 'aligned_answers_a_5m.csv').exists()
    head, *rows = rows_of(folder, 'aligned_poses_a_5m')
    cells = {row[1]: dict(zip(head, row, strict=True)) for row in rows}
    near = {f'within 10 m, {name}': figures for name, figures in (found.by_way | found.by_fault).items()}
    assert list(cells) == [*found.by_distance, *near]
    assert 'within 10 m, same way, same lane' in cells
    for name, figures in (found.by_distance | near).items():
        row = cells[name]
        assert row['pairs'] == str(figures.pairs)
        assert row['within 2 m, 2° (%)'] == f'{100 * figures.right:.2f}'
        assert (row['median (m)'], row['90 % (°)']) == (f'{figures.median_m:.2f}', f'{figures.quantile_90_deg:.2f}')
        assert row['NEES / 3'] == ('-' if math.isnan(figures.nees) else f'{figures.nees:.2f}')
    assert (folder / 'alignments_ring_key.png').read_bytes() == (
        folder / 'report' / 'figures' / 'alignments.png'
    ).read_bytes()


def test_answers_with_alignments_are_reported(source: Source) -> None:
    answers = AnswerFigures(
        queries=40,
        on_map=30,
        places=5,
        recall_at_1_by_distance=0.9,
        recall_at_1_aligned=0.95,
        recall_at_k=0.97,
        recall_at_10=1.0,
        at_precision=(RecallAtPrecision(0.99, 0.5, 0.75), RecallAtPrecision(0.999, 0.25, math.nan)),
        auroc_score=0.875,
        auroc_p_by_distance=0.9,
        auroc_p_aligned=0.96,
    )
    figures = AlignmentFigures(answers, {}, {}, {})
    results = dataclasses.replace(source.results, alignments={'a': {'5': {'ring_key': figures}}})
    changed = dataclasses.replace(source, results=results)
    (table,) = alignment_tables(changed, 'a', '5')
    assert 'k = 5 nearest places' in table.caption
    before, after = (dict(zip(table.head, row, strict=True)) for row in table.rows)
    assert (before['answers by'], after['answers by']) == ('distance', 'distance and score')
    for name, expected in {
        'queries': ('40', '40'),
        'on the map': ('30', '30'),
        'R@1 (%)': ('90.00', '95.00'),
        'R@k (%)': ('97.00', '97.00'),
        'R@10 (%)': ('100.00', '100.00'),
        'closed (%)': ('-', '50.00'),
        'recall at 0.99 (%)': ('50.00', '75.00'),
        'recall at 0.999 (%)': ('25.00', '-'),
        'AUROC of p_right': ('0.900', '0.960'),
        'AUROC of the score': ('-', '0.875'),
    }.items():
        assert (before[name], after[name]) == expected
    # Where nothing was aligned there is no table.
    assert not list(alignment_tables(changed, 'a', '15'))


def test_the_drives_are_reported(folder: Path) -> None:
    table = rows_of(folder, 'drives')
    assert [row[0] for row in table[1:]] == ['city_2999971_1', 'city_2999971_2', 'city_2999971_3', 'city_2999972_1']
    assert [row[2] for row in table[1:]] == ['12', '12', '12', '6']
    assert [row[4] for row in table[1:]] == ['mapped and searched'] * 3 + ['validation']
    assert all(40.0 < float(row[3]) < 75.0 for row in table[1:4])


def test_the_printed_f_columns_are_no_maxima_of_f_beta() -> None:
    """The reason why reports do not compare figures with these columns."""
    rows = [row for table in PAPER_TABLES.values() for row in table.values()]
    # To accept everything gives F_β = Recall@1 for every β: no maximum over thresholds is below that.
    below = sum(row.f_printed[1] + 0.005 < row.recall_at_1 / 100.0 for row in rows)
    assert (below, len(rows)) == (11, 13)
    # As printed, F1 is above the harmonic mean of F0.5 and F2 in every row, where it can be at most that.
    for row in rows:
        one, half, two = row.f_printed
        assert 1.0 / (one - 0.005) < (1.0 / (half + 0.005) + 1.0 / (two + 0.005)) / 2.0


def test_every_caption_names_simulated_scans(folder: Path) -> None:
    text = (folder / 'report' / 'report.md').read_text()
    pictures = re.findall(r'!\[.*\]\(figures/.*\.png\)\n\n(.*)\n', text)
    assert len(pictures) >= 7
    assert all('simulated' in caption.lower() for caption in pictures)


def test_markdown_and_page_have_the_same_sections_and_load_nothing(folder: Path) -> None:
    page = (folder / 'report' / 'report.html').read_text()
    text = (folder / 'report' / 'report.md').read_text()
    titles = re.findall('^## (.*)$', text, re.MULTILINE)
    assert [html.unescape(title) for title in re.findall('<h2>(.*)</h2>', page)] == titles
    assert 'Tiny &lt;cities&gt; &amp; ' in page
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    assert '<script' not in page
    for name in re.findall(r'figures/(.*\.png)', text):
        assert (folder / 'report' / 'figures' / name).read_bytes()[:4] == b'\x89PNG'


@pytest.mark.skipif(BROWSER is None, reason='no Chromium on this machine')
def test_a_browser_shows_every_figure_without_an_error(folder: Path, tmp_path: Path) -> None:
    page = (folder / 'report' / 'report.html').read_text()
    seen, errors = browse(page.replace('</body>', COUNT_SCRIPT + '</body>'), tmp_path)
    names = {path.stem for path in (folder / 'report' / 'figures').iterdir()}
    assert {name for name, _, _ in seen} == names
    assert all(width > 100 and described for _, width, described in seen)
    assert not errors
    # The check notices a damaged page.
    broken = page.replace('</body>', '<script>missing();</script>' + COUNT_SCRIPT + '</body>')
    broken = broken.replace('data:image/png;base64,iVBOR', 'data:image/png;base64,AAAAA', 1)
    seen, errors = browse(broken, tmp_path)
    assert errors
    assert any(width == 0 for _, width, _ in seen)


def browse(page: str, folder: Path) -> tuple[list[tuple[str, int, bool]], list[str]]:
    """Section, width and whether it is described, of each image; and errors on the console."""
    (folder / 'page.html').write_text(page)
    assert BROWSER is not None
    profile = folder / 'profile'
    command = [BROWSER, *FLAGS.split(), f'--user-data-dir={profile}', (folder / 'page.html').as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    found = re.search('data-images="([^"]*)"', done.stdout)
    assert found
    return json.loads(html.unescape(found[1])), re.findall('.*CONSOLE.*', done.stderr)


def test_a_folder_without_an_evaluation_is_refused(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(DataError, match=r'expected the results\.json'):
        read_source(tmp_path)
    shutil.copy(folder / 'results.json', tmp_path)
    with pytest.raises(DataError, match=r'expected scans\.npy and maps\.npz'):
        read_source(tmp_path)


def test_query_rows_give_the_recall_of_the_results(source: Source) -> None:
    results = source.results
    for maintained in (False, True):
        rows = source.query_rows('a', '15', 'ring_key', maintained)
        recall = float(np.mean(rows['rank'] == 0))
        expected = results.maintenance['a']['15']['ring_key'].recall_at_1['M' if maintained else 'O']
        assert recall == pytest.approx(expected)
