"""Pull the intermediate body against the end stops, in eight directions: the noise of the position sensors (6.2.1)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import ClassVar

import numpy as np

from campaigns.plans.base import Plan, channels_of, open_loop, rate_of, smooth_ramp
from campaigns.sizes import samples_of, samples_of_wave
from sim_backend.bench import Bench, Segment


class EndStops(Plan, frozen=True, kw_only=True):
    """Every actuator pulls up or down with `current_a`, in all combinations, and is held there for `hold_s`.

    The currents move along half a cosine in `ramp_s` and wait for `settle_s` until the mechanism lies still. Three
    actuators give eight positions. Against the stops the noise is slow: in 1 s each value scatters by 5 %, and the
    largest of eight positions and three heads would tell more of that scatter than of the bench. Only sensors are
    recorded: the heads where the bench has them, else its readings.
    """

    name: ClassVar[str] = "endstops"
    title: ClassVar[str] = "sensor noise against the end stops"
    overload_s: ClassVar[float] = 60.0
    """The paper does not print its current. At 1.5 A (9 N) the noise against the stops is 40 nm on the bench as built,
    above the sensors' 30 nm. Half the mechanism's time constant of 120 s, which is assumed, bounds the heat."""

    current_a: float = 6.0
    ramp_s: float = 0.5
    settle_s: float = 1.0
    hold_s: float = 4.0

    def __post_init__(self) -> None:
        self.require_positive("current_a", "ramp_s", "settle_s", "hold_s")

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return the sensor heads, or the readings of a bench that has none of its own."""
        return channels_of(bench, (), ("head_",)) or channels_of(bench, ("output",))

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield for every position a segment that moves there and one that holds; at the end the return."""
        rate, record = rate_of(bench), self.channels(bench)
        to_current = bench.limits.to_current
        to_command = np.linalg.pinv(to_current)
        ramp, settle = (samples_of_wave(t, rate) for t in (self.ramp_s, self.settle_s))
        hold = samples_of(self.hold_s, rate)
        at = np.zeros(len(bench.axes))
        for signs in product((1.0, -1.0), repeat=to_current.shape[0]):
            there = to_command @ (self.current_a * np.array(signs))
            name = "".join("+" if s > 0 else "-" for s in signs)
            way = np.vstack([smooth_ramp(at, there, ramp), np.tile(there, (settle, 1))])
            for phase, wave, n in (("pull", way, ramp + settle), ("hold", there[None, :], hold)):
                yield open_loop(f"{phase} {name}", wave, n, record, {"phase": phase, "signs": name})
            at = there
        yield open_loop("release", smooth_ramp(at, np.zeros_like(at), ramp), ramp, record, {"phase": "release"})
