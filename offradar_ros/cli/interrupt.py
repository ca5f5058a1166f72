"""Ctrl-C and SIGTERM, handled between two steps of a command."""

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Optional

import typer


@contextlib.contextmanager
def held_interrupt() -> Iterator[Callable[[], None]]:
    """Yields a function that raises KeyboardInterrupt if Ctrl-C was pressed: the interrupt comes where it is called.

    A second Ctrl-C is not delayed.
    """
    with held_signals(signal.SIGINT) as check:

        def interrupt() -> None:
            try:
                check()
            except Signalled:
                raise KeyboardInterrupt from None

        yield interrupt


@contextlib.contextmanager
def resumable() -> Iterator[None]:
    """Ends a command on Ctrl-C with a line that says that the same command continues."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo('\ninterrupted: the same command continues from here', err=True)
        raise typer.Exit(130) from None


class Signalled(Exception):
    """A signal was received; `status` is the exit status that reports it, 130 for SIGINT and 143 for SIGTERM."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.status = 128 + number


@contextlib.contextmanager
def held_signals(*numbers: signal.Signals) -> Iterator[Callable[[], None]]:
    """Yields a function that raises Signalled if one of the signals was received; a second one is not delayed."""
    received: list[int] = []
    before = {number: signal.getsignal(number) for number in numbers}

    def hold(number: int, _frame: Optional[FrameType]) -> None:
        received.append(number)
        signal.signal(number, before[signal.Signals(number)])

    def check() -> None:
        if received:
            raise Signalled(received[0])

    for number in numbers:
        signal.signal(number, hold)
    try:
        yield check
    finally:
        for number in numbers:
            signal.signal(number, before[number])
