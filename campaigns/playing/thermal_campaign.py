"""The thermal test as a small campaign: a long chop, and sweeps of both angles at two temperatures (6.4.3)."""

from __future__ import annotations

from typing import Any, Final

from campaigns.playing.campaign import Campaign, RunEntry

AXES: Final = ("theta_x", "theta_y")
COLD: Final = (77.0, 63.5)
"""The two temperatures of Fig. 6.17, in K."""

_BAND: Final = {"start_hz": 5.0, "stop_hz": 100.0, "step_hz": 5.0, "settle_s": 1.2, "measure_s": 0.4}


def sweep_name(kelvin: float, axis: str) -> str:
    """Return the name of the run that sweeps `axis` at `kelvin`."""
    return f"sweep-{kelvin:g}k-{axis}"


def thermal_campaign(settings: dict[str, Any], *, sweeps: bool) -> Campaign:
    """Return the chop with `settings`, and with `sweeps` four sweeps; raises ConfigError for settings that are not."""
    runs = [RunEntry(name="thermal", plan="thermal", settings=settings)]
    if sweeps:
        runs += [
            RunEntry(
                name=sweep_name(kelvin, axis),
                plan="sinesweep",
                settings={"axis": axis, "cold_finger_k": kelvin, "bands": [_BAND]},
            )
            for axis in AXES
            for kelvin in COLD
        ]
    campaign = Campaign(name="thermal", title="drift and temperature", runs=tuple(runs))
    campaign.plans()
    return campaign
