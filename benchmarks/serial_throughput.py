"""How much of a line's rate a segment uses, from its upload to its record, all questions included.

    python -m benchmarks.serial_throughput

The line is a real pseudo-terminal or TCP connection to the emulated bench in another process, throttled to a baud rate
or not at all. The result goes to benchmarks/results/.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import platform
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np

from campaigns.serial import EmulatorProcess, SerialBench, ServeOptions, transport_at
from campaigns.serial.emulator import PTY_BAUD
from campaigns.serial.server import CREDIT_S
from campaigns.version import tool_commit, tool_version
from sim_backend.bench import Segment

LINES: tuple[tuple[Literal["pty", "tcp"], int | None], ...] = (
    ("pty", 115_200),
    ("pty", 921_600),
    ("pty", 3_000_000),
    ("tcp", 921_600),
    ("pty", None),
    ("tcp", None),
)
SECONDS = 4.0
FREE_BYTES = 10_000_000
CHANNELS = ("theta_x", "theta_y", "z", "command_theta_x", "command_theta_y", "command_z")


def measure(transport: Literal["pty", "tcp"], baud: int | None) -> dict[str, object]:
    """Play a segment whose bytes take some seconds; return its rate in bytes/s and its share of the line's."""
    with EmulatorProcess(ServeOptions(transport=transport, baud=baud)) as emulator:
        kind, _, rest = emulator.address.partition(":")
        line = transport_at(kind, f"{rest}@{baud or PTY_BAUD}" if kind == "serial" else rest)
        with contextlib.closing(SerialBench(line, kind)) as bench:
            wave = 1e-5 * np.random.default_rng(0).standard_normal((200, 3))
            n_samples = int((FREE_BYTES if baud is None else baud / 10 * SECONDS) / (8 * len(CHANNELS)))
            segment = Segment("measured", n_samples, np.zeros_like(wave), wave, record=CHANNELS)
            # at each end the throttle lends what a line lets pass in CREDIT_S: that is counted as time
            lent_s = 0.0 if baud is None else 2 * CREDIT_S
            size = 8 * (n_samples * len(CHANNELS) + wave.size)
            rates = []
            for _ in range(3):
                started_s = time.monotonic()
                bench.play(segment)
                rates.append(size / (time.monotonic() - started_s + lent_s))
    shares = None if baud is None else [round(rate / (baud / 10), 3) for rate in rates]
    return {"line": transport, "baud": baud, "bytes_per_s": [round(rate) for rate in rates], "share_of_line": shares}


def main() -> int:
    """Measure every line and write the result; exit code 1 if a throttled one is used to less than 90 %."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results")
    options = parser.parse_args()
    measured = [measure(transport, baud) for transport, baud in LINES]
    result = {
        "mccd": f"{tool_version()} (commit {tool_commit()})",
        "machine": f"Python {platform.python_version()}, {platform.system()} {platform.machine()}",
        "command": " ".join(["python -m benchmarks.serial_throughput", *sys.argv[1:]]),
        "must_reach": 0.9,
        "lines": measured,
    }
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / f"serial-throughput-{datetime.now(UTC):%Y-%m-%d}.json"
    path.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(path.read_text(encoding="utf-8"))
    best = [max(line["share_of_line"]) for line in measured if isinstance(line["share_of_line"], list)]
    return 0 if min(best) >= 0.9 else 1


if __name__ == "__main__":
    sys.exit(main())
