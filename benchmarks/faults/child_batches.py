"""Many tries in child processes: one that crashes, hangs or eats memory is counted, and the others go on."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import resource
import selectors
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from typing import NoReturn

from faults.result import CRASHED, REFUSED, Verdict
from offradar_ros.errors import OffradarError

LANES = 2
"""Child processes at a time."""
SILENT_S = 60.0
"""A child that reports nothing for longer than this hangs; the slowest try takes well below a second."""
MEMORY_BYTES = 6 * 1024**3
"""Address space of a child: a try that asks for more ends in a MemoryError, not in a machine that swaps."""

Attempt = Callable[[int], Verdict]


def run_in_children(count: int, attempt: Attempt, *, lanes: int = LANES) -> list[Verdict]:
    """The verdicts of tries 0 to `count` - 1; `attempt` runs in forked children, and an OffradarError is a refusal."""
    verdicts: dict[int, Verdict] = {}
    children: list[_Child] = []
    with selectors.DefaultSelector() as selector:

        def start(numbers: Sequence[int]) -> None:
            child = _Child(numbers, attempt)
            children.append(child)
            selector.register(child.reader, selectors.EVENT_READ, child)

        try:
            for lane in range(min(lanes, count)):
                start(range(lane, count, lanes))
            while children:
                for child in [key.data for key, _ in selector.select(timeout=1.0)]:
                    verdicts.update(child.read())
                for child in [child for child in children if child.has_ended or child.is_silent]:
                    selector.unregister(child.reader)
                    children.remove(child)
                    verdicts.update(child.close())
                    # The try that ended the child is judged; the child's other tries go on in a new one.
                    if left := [number for number in child.numbers if number not in verdicts]:
                        start(left)
        finally:
            for child in children:
                child.close()
    return [verdicts[number] for number in range(count)]


class _Child:
    def __init__(self, numbers: Sequence[int], attempt: Attempt) -> None:
        self.numbers = list(numbers)
        self.reader, writer = os.pipe()
        # What is buffered here would be printed again by the child.
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        if self.pid == 0:
            # A group of its own: what a try starts ends with it.
            os.setsid()
            os.close(self.reader)
            _work(self.numbers, attempt, writer)
        os.close(writer)
        self.has_ended = False
        self._heard_s = time.monotonic()
        self._buffer = b''
        self._done = 0

    @property
    def is_silent(self) -> bool:
        return time.monotonic() - self._heard_s > SILENT_S

    def read(self) -> dict[int, Verdict]:
        """Verdicts that have arrived."""
        received = os.read(self.reader, 65536)
        self._heard_s = time.monotonic()
        self.has_ended = not received
        *lines, self._buffer = (self._buffer + received).split(b'\n')
        found = {}
        for line in lines:
            word, _, detail = line.decode('utf-8', 'replace').partition(' ')
            found[self.numbers[self._done]] = Verdict(word, detail)
            self._done += 1
        return found

    def close(self) -> dict[int, Verdict]:
        """End the child; the verdict of the try that it was at, if it did not finish."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        os.close(self.reader)
        _, status = os.waitpid(self.pid, 0)
        if self._done == len(self.numbers):
            return {}
        code = os.waitstatus_to_exitcode(status)
        how = f'no answer within {SILENT_S:g} s' if not self.has_ended else f'the process ended with status {code}'
        return {self.numbers[self._done]: Verdict(CRASHED, how)}


def _work(numbers: Sequence[int], attempt: Attempt, writer: int) -> NoReturn:
    # What a try prints is of no interest, and a crash is expected: no core files.
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    faulthandler.disable()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    try:
        for number in numbers:
            verdict = judged(attempt, number)
            line = f'{verdict.word} {" ".join(verdict.detail.split())[:400]}\n'
            os.write(writer, line.encode('utf-8', 'replace'))
    finally:
        # Without the clean-up of the parent's objects that a fork shares.
        os._exit(0)


def judged(attempt: Attempt, number: int) -> Verdict:
    """The verdict of one try: a known error of one line is a refusal, every other error a crash."""
    try:
        return attempt(number)
    except OffradarError as error:
        text = str(error)
        if not text.strip() or '\n' in text:
            return Verdict(CRASHED, f'{type(error).__name__} of {len(text.splitlines())} lines: {text[:200]!r}')
        return Verdict(REFUSED, text)
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return Verdict(CRASHED, f'{type(error).__name__}: {error} ({where.filename}:{where.lineno})')
