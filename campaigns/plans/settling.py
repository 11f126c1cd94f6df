"""A 5 Hz chop of one axis between 0 and 8.5 mrad: settling by each strategy (6.4.2, 6.5)."""

from __future__ import annotations

from typing import ClassVar

from campaigns.plans.base import channels_of
from campaigns.plans.chop import ChopPlan
from sim_backend.bench import Bench


class Settling(ChopPlan, frozen=True, kw_only=True):
    """A fast chop, to measure settling; `alpha_deg` 0 is θx, 90 is θy.

    A learning strategy learns first; the `cycles` periods of the chop come after that.
    """

    name: ClassVar[str] = "settling"
    title: ClassVar[str] = "settling of a fast chop"

    frequency_hz: float = 5.0
    cycles: int = 25
    window_s: float = 0.05

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return commands, readings and actuator currents, which give power and peak current."""
        return channels_of(bench, ("input", "output"), ("current_",))
