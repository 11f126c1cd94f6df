"""What signals do to a running test: the first Ctrl-C ends it after the current segment, the second at once.

SIGTERM and a closed terminal end it at once too. "At once" is as soon as the test waits for the bench: a signal
interrupts neither a write nor making the bench safe.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, Self

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Terminated(KeyboardInterrupt):
    """The process was told to end (SIGTERM or SIGHUP)."""


class Interrupts:
    """Signal handlers for the time of a run; use as a context manager, in the main thread (elsewhere it does nothing).

    `pausing` is set by the first Ctrl-C. An abort raises KeyboardInterrupt, or Terminated, inside `abortable()` alone;
    one that came at another time is raised when that is next entered, or at the latest when the context ends. Threads
    that share it pause and abort likewise, the latter whenever they enter `abortable()`.
    """

    def __init__(self) -> None:
        self.pausing = False
        self._owner = threading.get_ident()
        self._abortable = False
        self._aborted: type[KeyboardInterrupt] | None = None
        self._pending: type[KeyboardInterrupt] | None = None
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in ENDING_SIGNALS:
                self._before[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        if kind is None:
            self._raise_pending()

    @contextlib.contextmanager
    def abortable(self) -> Iterator[None]:
        """Let an abort happen inside the block; in a helper's thread, which gets no signals, at its start alone."""
        if threading.get_ident() != self._owner:
            if self._aborted is not None:
                raise self._aborted
            yield
            return
        self._abortable = True
        try:
            self._raise_pending()
            yield
        finally:
            self._abortable = False

    def _raise_pending(self) -> None:
        if self._pending is not None:
            pending, self._pending = self._pending, None
            raise pending

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT and not self.pausing:
            self.pausing = True
            return
        self._pending = self._aborted = KeyboardInterrupt if number == signal.SIGINT else Terminated
        if self._abortable:
            self._raise_pending()
