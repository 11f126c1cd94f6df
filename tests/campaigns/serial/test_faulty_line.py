"""Damaged lines: right data or a clear error, in time, and the bench safe. A short selection of the soak.

`python -m benchmarks.soak_serial` runs any number of drawn seeds; here every kind has one line of its own, at a rate
at which it strikes for certain, and a few drawn seeds in a row.
"""

from __future__ import annotations

import time

import pytest

from campaigns.serial import SerialBench, transport_at
from sim_backend.errors import HardwareError
from sim_backend.model import load_model
from sim_backend.simbench import SimBench
from tests.campaigns.serial.conftest import Serve, Served, differences, loop_segments

WATCHDOG_S = 2.0
BOUND_S = 14 * 27.0 + 150.0
"""As derived in benchmarks/soak_serial.py, for the four segments of loop_segments() with 540 blocks in all."""


def play(served: Served, model_path: str) -> tuple[str, float]:
    """Play segments over the line; return `right`, or the message of a clear error, and how long it took."""
    kind, _, rest = served.address.partition(":")
    direct = SimBench(load_model(model_path), 5)
    started_s = time.monotonic()
    try:
        bench = SerialBench(
            transport_at(kind, f"{rest}@4000000" if kind == "serial" else rest), kind, watchdog_s=WATCHDOG_S
        )
    except HardwareError as error:
        return str(error), time.monotonic() - started_s
    try:
        for segment in loop_segments():
            assert differences(bench.play(segment), direct.play(segment)) == []
        return "right", time.monotonic() - started_s
    except HardwareError as error:
        return str(error), time.monotonic() - started_s
    finally:
        bench.close()


def becomes_safe(served: Served, within_s: float) -> bool:
    end_s = time.monotonic() + within_s
    while served.state not in ("idle", "fault"):
        if time.monotonic() > end_s:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.parametrize(
    ("transport", "faults"),
    [
        ("pty", "flip=5e-5"),
        ("tcp", "lose=5e-5"),
        ("pty", "repeat=1e-4"),
        ("tcp", "garbage=1e-4"),
        ("tcp", "delay=2e-5"),
        ("pty", "drop=2e-5"),
        ("tcp", "drop=2e-5"),
    ],
)
def test_a_damaged_line_gives_right_data(serve: Serve, model_path: str, transport: str, faults: str) -> None:
    """At these rates about nine blocks in ten pass, so that twenty failures of one block in a row do not happen."""
    served = serve(transport=transport, faults=f"3/{faults}")
    result, seconds = play(served, model_path)
    assert result == "right"
    assert seconds < BOUND_S
    assert becomes_safe(served, WATCHDOG_S + 1.0)
    served.process.close()
    assert faults.partition("=")[0] in served.journal[-1]  # the fault did strike


def test_a_firmware_that_restarts_is_told_as_such(serve: Serve, model_path: str) -> None:
    served = serve(faults="3/reset=1e-5")
    result, _ = play(served, model_path)
    assert "restarted" in result and "begin it anew" in result
    assert becomes_safe(served, WATCHDOG_S + 1.0)


def test_a_bench_that_stalls_again_and_again_is_told_as_such(serve: Serve, model_path: str) -> None:
    served = serve(faults="3/stall=3e-3")
    result, seconds = play(served, model_path)
    assert "does not answer" in result or "no answer" in result or "time is up" in result
    assert seconds < BOUND_S
    assert becomes_safe(served, WATCHDOG_S + 4.0)


def test_a_process_that_dies_is_told_as_such(serve: Serve) -> None:
    served = serve(transport="tcp", speed=0.01)
    bench = SerialBench(transport_at("tcp", served.address.partition(":")[2]), "tcp")
    served.process.process.kill()
    with pytest.raises(HardwareError, match="cannot be reached"):
        bench.play(loop_segments()[0])
    bench.safe()  # never raises
    assert not bench.left_safe


@pytest.mark.parametrize("seed", range(2000, 2002))
def test_drawn_faults_keep_the_promises(serve: Serve, model_path: str, seed: int) -> None:
    served = serve(transport=("pty", "tcp")[seed % 2], faults=str(seed))
    result, seconds = play(served, model_path)  # wrong data or another error fails within
    assert result and seconds < BOUND_S
    assert becomes_safe(served, WATCHDOG_S + 4.0)
