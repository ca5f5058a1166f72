"""What methods cost, U of recorded scans, and what the weights that ship are held to."""

from __future__ import annotations

from collections.abc import Iterator

from offradar_ros.lab.evaluation.table import number
from offradar_ros.lab.report.sections import TableSection
from offradar_ros.lab.report.source import Source
from offradar_ros.lab.report.words import name_of


def drives_table(source: Source) -> TableSection:
    """What was driven, and how often it counts."""
    rows = tuple(
        (
            drive['name'],
            key.split('/', 1)[1],
            str(drive['scans']),
            f'{drive["way_m"]:.0f}',
            drive['roles'],
        )
        for key, drives in source.results['drives'].items()
        for drive in drives
    )
    return TableSection(
        'drives',
        'What was driven',
        'A scan counts as often as there are maps in which it is searched. Scans that are left out, for their spacing, '
        'region or want of a position, are not counted here.',
        ('drive', 'road', 'scans', 'way (m)', 'role'),
        rows,
    )


def cost_table(source: Source) -> TableSection:
    """Time and memory of every method."""
    rows = []
    machine = source.results['machine']
    peaks = [told['cost']['peak_memory_mb'] for told in source.results['methods'].values()]
    for name in source.methods:
        told = source.results['methods'][name]
        cost = told['cost']
        numbers = [cost['encode_ms'], cost['search_ms'], cost['bytes_a_place'] / 1000.0]
        texts = ('-' if value is None else f'{value:.3g}' for value in numbers)
        rows.append((name_of(name), str(told['dimension']), *texts))
    return TableSection(
        'cost',
        'Cost',
        f'Medians on {machine["processor"]}, {machine["cores"]} cores: encoding one scan from its polar image, finding '
        'ten places in a map of the mean size; memory of a descriptor. The evaluation took '
        f'{max(peaks):.0f} MB of memory at most.',
        ('method', 'dimension', 'encode (ms)', 'search (ms)', 'a place (kB)'),
        tuple(rows),
    )


def recorded_tables(source: Source) -> Iterator[TableSection]:
    """U of recorded scans, clean and spoiled, where it was measured."""
    told = source.results.get('recorded')
    if not told:
        return
    kinds = list(next(iter(told.values())))
    rows = tuple((name_of(name), *(number(told[name][kind]['mean']) for kind in kinds)) for name in source.methods)
    yield TableSection(
        'recorded_scans',
        'U of recorded scans',
        'Mean U of recorded scans of Oxford Radar RobotCar as they are and spoiled, and of RADIATE in fog.',
        ('method', *kinds),
        rows,
    )


def target_tables(source: Source) -> Iterator[TableSection]:
    """What the weights that ship are held to, where the protocol says so."""
    rows = tuple(
        (
            t['text'],
            ' '.join(filter(None, [t['group'], t['spacing_m'] and f'{t["spacing_m"]} m'])),
            t['wanted'],
            number(t['found']),
            'reached' if t['passed'] else 'missed',
        )
        for t in source.results['targets']
    )
    if rows:
        yield TableSection('targets', 'Targets', 'Of method ours.', ('what', 'where', 'wanted', 'found', ''), rows)
