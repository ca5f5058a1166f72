"""An executor that is spun in a thread of its own, beside a program that starts and watches nodes."""

from __future__ import annotations

import contextlib
import threading

from rclpy.executors import Executor, ExternalShutdownException

POLL_S = 0.1


class SpinThread:
    """Spins `executor` until `stop`, or until its context is shut down."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._spin, name='spin', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Return when no callback runs any more, with the executor shut down; may be called again."""
        self._stopped.set()
        self._executor.wake()
        self._thread.join()
        # Only now: rclpy's executors raise in the thread that spins them when another one shuts them down.
        self._executor.shutdown()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self._stopped.is_set():
                self._executor.spin_once(timeout_sec=POLL_S)
