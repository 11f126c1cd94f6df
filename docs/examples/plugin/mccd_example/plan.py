"""One torque pulse in open loop, and the ringing after it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from campaigns.plans.base import Plan, on_axis, open_loop, rate_of
from campaigns.sizes import samples_of
from sim_backend.bench import Bench, Segment


class Pulse(Plan, frozen=True, kw_only=True):
    """A torque of `torque_nm` for `pulse_s`, then nothing, for `duration_s` in all."""

    name: ClassVar[str] = "pulse"
    title: ClassVar[str] = "one torque pulse"

    axis: str = "theta_x"
    torque_nm: float = 0.01
    pulse_s: float = 0.005
    duration_s: float = 0.5

    def __post_init__(self) -> None:
        self.require_positive("torque_nm", "pulse_s", "duration_s")
        self.require(self.pulse_s < self.duration_s, "pulse_s", f"shorter than duration_s, {self.duration_s} s")

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield the pulse with its ringing."""
        wave = np.zeros(samples_of(self.duration_s, rate_of(bench)))
        wave[: samples_of(self.pulse_s, rate_of(bench))] = self.torque_nm
        command = on_axis(bench, self.axis, wave)
        yield open_loop("pulse", command, wave.size, self.channels(bench), {"torque_nm": self.torque_nm})
