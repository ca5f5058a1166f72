"""A progress bar with the time left."""

import contextlib
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


@contextlib.contextmanager
def progress_bar(text: str) -> Iterator[Callable[[float, float], None]]:
    """Yields a function of (done, total) that draws on stderr; nothing is drawn before its first call."""
    progress = Progress(
        TextColumn('{task.description}', markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn('left'),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )
    task = progress.add_task(text, total=None)

    def draw(done: float, total: float) -> None:
        progress.start()
        progress.update(task, completed=done, total=total)

    try:
        yield draw
    finally:
        if progress.live.is_started:
            progress.stop()
