"""How long waveforms, stretches and runs may be: bounds that are kept before memory is taken and anything moves."""

from __future__ import annotations

import math
import sys

from sim_backend.errors import ConfigError

BYTES_PER_VALUE = 8

MOST_IN_WAVEFORM = 2**22
"""Samples of a waveform, which lies in memory for all axes and a few times over, in 1 GB: 7 minutes at 10 kHz."""

MOST_IN_WAIT = 2**25
"""Samples for which one value is held: 56 minutes at 10 kHz."""

MOST_AT_ONCE_BYTES = 4e9
"""What a segment may record: it lies in memory until it is written."""

MOST_IN_RUN_H = 100.0
"""Hours of a run: the tables of a log allow 119 at 10 kHz."""

MOST_RUNS = 1000
MOST_IN_CAMPAIGN_H = 1000.0
"""Of a campaign, all runs together."""

MOST_SEGMENTS = 100_000
"""Steps of a run: each is in the log's table with a label of its own."""


def samples_of(duration_s: float, rate_hz: float) -> int:
    """Return the whole number of samples nearest to a duration for which one value is held, at least one.

    Raises ConfigError for more than a wait may have.
    """
    return max(_whole(duration_s * rate_hz, rate_hz, "a wait", MOST_IN_WAIT), 1)


def samples_of_wave(duration_s: float, rate_hz: float) -> int:
    """Return the whole number of samples nearest to the duration of a waveform, at least one.

    Raises ConfigError for more than a waveform may have.
    """
    return max(wave_samples(duration_s * rate_hz, rate_hz), 1)


def wave_samples(wanted: float, rate_hz: float) -> int:
    """Return `wanted` as a whole number of samples; raises ConfigError for more than a waveform may have."""
    return _whole(wanted, rate_hz, "a waveform", MOST_IN_WAVEFORM)


def _whole(wanted: float, rate_hz: float, what: str, most: int) -> int:
    if not wanted <= most:
        wanted = min(wanted, sys.float_info.max)
        raise ConfigError(
            f"{what} would take {wanted / rate_hz:.4g} s, {wanted:.3g} samples at {rate_hz:g} Hz; the limit is "
            f"{most / rate_hz:.4g} s, {most} samples: shorten it"
        )
    return round(wanted)


def hours_of(samples: float, rate_hz: float) -> float:
    """Return how long so many samples take, in hours."""
    return samples / rate_hz / 3600.0


def require_run(what: str, samples: float, segments: float, channels: int, rate_hz: float) -> None:
    """Raise ConfigError for a run of more hours or segments than a log can hold; `samples` may be a lower bound."""
    hours = hours_of(samples, rate_hz)
    if hours <= MOST_IN_RUN_H and segments <= MOST_SEGMENTS:
        return
    gigabytes = samples * channels * BYTES_PER_VALUE / 1e9
    raise ConfigError(
        f"{what} would take {hours:.4g} h, {segments:.4g} steps and {gigabytes:.4g} GB or more; a run may take "
        f"{MOST_IN_RUN_H:g} h and {MOST_SEGMENTS} steps: ask for fewer or shorter ones, or for several runs"
    )


def require_campaign(name: str, duration_s: float, size_bytes: float) -> None:
    """Raise ConfigError for a campaign that takes too long, all runs together."""
    hours = duration_s / 3600.0
    if hours > MOST_IN_CAMPAIGN_H:
        raise ConfigError(
            f"campaign '{name}' would take {hours:.4g} h and {size_bytes / 1e9:.4g} GB; the limit is "
            f"{MOST_IN_CAMPAIGN_H:g} h: make several of it"
        )


def require_at_once(what: str, samples: float, channels: int, rate_hz: float) -> None:
    """Raise ConfigError for a segment whose record does not fit into memory."""
    size = samples * channels * BYTES_PER_VALUE
    if size > MOST_AT_ONCE_BYTES:
        limit = math.floor(MOST_AT_ONCE_BYTES / (channels * BYTES_PER_VALUE * rate_hz))
        raise ConfigError(
            f"{what} would record {samples / rate_hz:.4g} s and {size / 1e9:.4g} GB at once; the limit is {limit} s "
            f"and {MOST_AT_ONCE_BYTES / 1e9:g} GB: shorten it, or make several runs"
        )
