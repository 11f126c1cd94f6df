"""Ctrl-C for what goes on until then: heard between two looks at a log, for it may be lost within one.

Python raises KeyboardInterrupt between any two instructions. Inside a finaliser or the removal of a weak reference, as
the HDF5 library's objects have them by the hundred, it is printed and forgotten: of 250 watched runs two went on.
"""

from __future__ import annotations

import select
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def awaited() -> Iterator[Callable[[float], bool]]:
    """Yield what waits for so many seconds or until Ctrl-C, and tells which; in the main thread alone.

    Inside the block the first Ctrl-C does nothing else, and a second one raises KeyboardInterrupt, for a disk that does
    not answer.
    """
    hearing, told = socket.socketpair()
    told.setblocking(False)

    heard = False

    def pressed(*_: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def within(seconds: float) -> bool:
        nonlocal heard
        end_s = time.monotonic() + seconds
        while not heard and select.select([hearing], [], [], max(end_s - time.monotonic(), 0.0))[0]:
            heard = signal.SIGINT in hearing.recv(64)  # the number of every signal is written there as it comes
        return heard

    with hearing, told:
        before = signal.getsignal(signal.SIGINT)
        if before is not signal.SIG_IGN:  # as a shell starts what it leaves in the background
            signal.signal(signal.SIGINT, pressed)
        wakened = signal.set_wakeup_fd(told.fileno(), warn_on_full_buffer=False)
        try:
            yield within
        finally:
            signal.set_wakeup_fd(wakened)
            signal.signal(signal.SIGINT, before)
