"""Identification as a small campaign: one stepped sine per axis."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from typing import Any

from campaigns.benches import open_bench
from campaigns.plans.base import axis_of
from campaigns.playing.campaign import Campaign, RunEntry
from sim_backend.errors import ConfigError

Z_AMPLITUDE_N = 0.01
"""Force on z that keeps its resonance, 13 times the static 0.6 mm/N, within the end stops."""


def sweep_campaign(address: str, axes: Sequence[str], settings: dict[str, Any]) -> Campaign:
    """Return a sweep of each of `axes`, of all of the bench's when there is none, with `settings`.

    Raises ConfigError for a bench, an axis or settings that do not exist.
    """
    if "axis" in settings:
        raise ConfigError(f"the setting axis is {settings['axis']}, and every axis has a sweep of its own; use --axis")
    with closing(open_bench(address, 0)) as bench:
        for axis in axes:
            axis_of(bench, axis)
        chosen = tuple(axes) or bench.axes
    runs = tuple(
        RunEntry(
            name=f"sweep-{axis}",
            plan="sinesweep",
            settings={"axis": axis, **({"amplitude": Z_AMPLITUDE_N} if axis == "z" else {}), **settings},
        )
        for axis in chosen
    )
    campaign = Campaign(name="identify", title="stepped sine sweeps", runs=runs)
    campaign.plans()
    return campaign
