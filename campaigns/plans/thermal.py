"""Five minutes of a 5 Hz chop: drift of the chopped positions as the mechanism warms up (6.4.3)."""

from __future__ import annotations

from typing import ClassVar

from campaigns.plans.base import channels_of
from campaigns.plans.chop import ChopPlan
from sim_backend.bench import Bench


class Thermal(ChopPlan, frozen=True, kw_only=True):
    """A long fast chop; only readings and temperature are recorded, one channel of 5 minutes being 24 MB."""

    name: ClassVar[str] = "thermal"
    title: ClassVar[str] = "drift during a long chop"

    alpha_deg: float = 90.0
    frequency_hz: float = 5.0
    cycles: int = 1500
    window_s: float = 0.05

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return the readings and the temperature."""
        return channels_of(bench, ("output",), ("temperature",))
