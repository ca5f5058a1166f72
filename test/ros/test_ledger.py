"""What became of messages adds up, also while they end."""

from __future__ import annotations

import sys
from collections import Counter

from offradar_ros.ros.ledger import Ledger
from offradar_ros.ros.newest_worker import NewestWorker


def test_at_any_time_what_was_received_has_ended_or_waits() -> None:
    ledger = Ledger('scans')
    worker = NewestWorker[int](lambda _: ledger.settle('encoded'), lambda _: ledger.settle('overtaken'), 3)
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    sums: Counter[int] = Counter()
    try:
        for number in range(2000):
            ledger.receive()
            worker.put(number)
            counts = {key.removeprefix('scans.'): int(value) for key, value in ledger.values().items()}
            ends = counts.get('encoded', 0) + counts.get('overtaken', 0)
            sums[counts['received'] - ends - counts['waiting']] += 1
    finally:
        sys.setswitchinterval(interval_s)
        for _ in worker.stop():
            ledger.settle('inactive')
    assert sums == {0: 2000}
    assert sum(ledger.ends.values()) == ledger.received == 2000
    assert ledger.values()['scans.waiting'] == '0'


def test_a_report_names_what_it_counts() -> None:
    ledger = Ledger('embeddings')
    for _ in range(3):
        ledger.receive()
    ledger.settle('refused')
    ledger.lose(4)
    assert ledger.values() == {
        'embeddings.received': '3',
        'embeddings.refused': '1',
        'embeddings.lost_before_arrival': '4',
        'embeddings.waiting': '2',
    }
