"""An executor that is spun in a separate thread, for programs that start and observe nodes."""

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
        """Shut the executor down; returns when no callback runs any more. May be called again."""
        self._stopped.set()
        self._executor.wake()
        self._thread.join()
        # After the thread: an executor of rclpy raises in the thread that spins it if another thread shuts it down.
        self._executor.shutdown()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self._stopped.is_set():
                self._executor.spin_once(timeout_sec=POLL_S)
