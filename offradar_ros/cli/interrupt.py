"""Ctrl-C at a moment of our choosing."""

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Optional


@contextlib.contextmanager
def held_interrupt() -> Iterator[Callable[[], None]]:
    """Yields a function that raises KeyboardInterrupt where Ctrl-C was pressed since, so that it comes between scans.

    A second Ctrl-C is not held back.
    """
    pressed = False
    before = signal.getsignal(signal.SIGINT)

    def hold(_signal: int, _frame: Optional[FrameType]) -> None:
        nonlocal pressed
        pressed = True
        signal.signal(signal.SIGINT, before)

    def check() -> None:
        if pressed:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, hold)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
