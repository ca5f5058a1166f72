"""A try that crashes, hangs, eats memory or raises what nobody knows is counted, and the others go on."""

from __future__ import annotations

import os
import signal
import time

import pytest
from faults import child_batches
from faults.child_batches import run_in_children
from faults.result import CRASHED, LOST, REFUSED, SAME, Verdict, summed

from offradar_ros.errors import DataError


def attempt(number: int) -> Verdict:
    if number == 2:
        os.kill(os.getpid(), signal.SIGSEGV)
    if number == 3:
        raise DataError('file.csv, line 7: expected a number')
    if number == 5:
        raise DataError('an error of\ntwo lines')
    if number == 6:
        raise KeyError('stamp')
    if number == 7:
        bytearray(2**40)
    if number == 8:
        os._exit(0)
    if number == 9:
        time.sleep(600.0)
    return Verdict(SAME)


def test_each_try_has_its_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_batches, 'SILENT_S', 3.0)
    words = [verdict.word for verdict in run_in_children(12, attempt)]
    expected = {2: CRASHED, 3: REFUSED, 5: CRASHED, 6: CRASHED, 7: CRASHED, 8: CRASHED, 9: CRASHED}
    assert words == [expected.get(number, SAME) for number in range(12)]


def test_failures_are_summed_and_quoted() -> None:
    result = summed('name', 'kind', [Verdict(SAME), Verdict(CRASHED, 'status -11'), Verdict(LOST, 'session 4')], 1.5)
    assert (result.tries, result.same, result.crashes, result.losses, result.failures) == (3, 1, 1, 1, 2)
    assert result.examples == ('try 1: crashed: status -11', 'try 2: lost: session 4')
