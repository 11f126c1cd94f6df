"""Ctrl-C while something goes on until then: heard wherever it comes."""

from __future__ import annotations

import os
import signal
import sys
import time

import pytest

from analysis.recorded.ctrl_c import awaited

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a process cannot send itself Ctrl-C there")


class Finalised:
    """Gets Ctrl-C in its finaliser, where Python forgets what is raised."""

    def __del__(self) -> None:
        os.kill(os.getpid(), signal.SIGINT)


def test_one_that_comes_within_a_finaliser_is_heard_at_the_next_wait():
    before = signal.getsignal(signal.SIGINT)
    with awaited() as ctrl_c_within:
        assert not ctrl_c_within(0.0)
        one = Finalised()
        del one
        assert ctrl_c_within(60.0)
    assert signal.getsignal(signal.SIGINT) is before


def test_one_that_comes_while_we_wait_ends_the_wait():
    with awaited() as ctrl_c_within:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        at_alarm = signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), signal.SIGINT))
        start_s = time.monotonic()
        assert ctrl_c_within(60.0) and time.monotonic() - start_s < 30.0
    signal.signal(signal.SIGALRM, at_alarm)


def test_a_second_one_interrupts_what_hangs():
    with awaited():
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_who_ignores_it_goes_on_ignoring_it():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with awaited() as ctrl_c_within:
            os.kill(os.getpid(), signal.SIGINT)
            assert not ctrl_c_within(0.0)
    finally:
        signal.signal(signal.SIGINT, before)
