"""The schema of a log: what a file of version `mccd-log/1` must and may contain."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Protocol

import h5py
import numpy as np

from campaigns.log.limits import check_note, check_text
from campaigns.log.units import unit_named
from campaigns.names import check_label, check_name
from sim_backend.errors import ConfigError

SCHEMA = "mccd-log/1"
ROLES = ("input", "output", "reference", "aux")
OPEN_STATUS = "running"
FINAL_STATUSES = ("complete", "paused", "aborted", "failed", "crashed")
HELD_OUT = "held-out"
CHANNELS = "channels"
SEGMENTS = "segments"
COMMITTED = "committed_rows"
EXPECTED = "expected_rows"
OPEN_STOP = -1
LABEL_BYTES = 128
MAX_IDENTITY_CHARS = 256


class ChannelLike(Protocol):
    """Whatever describes a channel: the signals of a bench do, and so does `Channel`."""

    @property
    def name(self) -> str:
        """Name of the dataset below `channels`."""

    @property
    def unit(self) -> str:
        """Accepted unit symbol, coherent SI."""

    @property
    def role(self) -> str:
        """One of `ROLES`."""

    @property
    def dof(self) -> str:
        """Degree of freedom or location that the channel belongs to."""

    @property
    def sample_rate_hz(self) -> float:
        """Samples per second."""

    @property
    def t0_s(self) -> float:
        """Time of the first sample after the start of the run."""


@dataclass(frozen=True)
class Channel:
    """What one channel is; raises ConfigError for a name, unit, role, rate or time that a log cannot hold."""

    name: str
    unit: str
    role: str
    dof: str
    sample_rate_hz: float
    t0_s: float = 0.0

    def __post_init__(self) -> None:
        check_name(self.name, "channel")
        si = unit_named(self.unit).si
        if si != self.unit:
            raise ConfigError(f"channel '{self.name}' has unit '{self.unit}': a log stores SI, convert to '{si}'")
        if self.role not in ROLES:
            raise ConfigError(f"channel '{self.name}' has role '{self.role}': use one of {', '.join(ROLES)}")
        if not (np.isfinite(self.sample_rate_hz) and 0.0 < self.sample_rate_hz <= 1e9):
            raise ConfigError(
                f"channel '{self.name}' has sample rate {self.sample_rate_hz} Hz: give a number above 0 and up to 1e9"
            )
        check_text(self.dof, f"dof of channel '{self.name}'")
        if not np.isfinite(self.t0_s):
            raise ConfigError(f"channel '{self.name}' starts at {self.t0_s} s: give a finite time")

    @classmethod
    def of(cls, like: ChannelLike) -> Channel:
        """Return the channel that an object with its attributes describes; raises as `Channel`."""
        return cls(like.name, like.unit, like.role, like.dof, float(like.sample_rate_hz), float(like.t0_s))


@dataclass(frozen=True)
class LogSegment:
    """Samples `start` to `stop` (exclusive) of every channel, with the settings they were recorded under."""

    label: str
    start: int
    stop: int
    settings: Mapping[str, Any]

    @property
    def held_out(self) -> bool:
        """Whether the label keeps these samples from every fit."""
        return HELD_OUT in self.label

    @property
    def rows(self) -> int:
        """Number of samples."""
        return self.stop - self.start


@dataclass(frozen=True)
class Header:
    """The root attributes of a log; `bench` is its public identity alone, never a parameter of it.

    `note` is what a user said of the run, empty where nothing. Raises ConfigError for a status, time, identity or note
    that a log cannot hold.
    """

    run_uid: str
    test: str
    bench: Mapping[str, str]
    configuration: str
    seed: int | None
    started_utc: str
    tool_version: str
    tool_commit: str
    status: str = OPEN_STATUS
    status_reason: str = ""
    ended_utc: str = ""
    note: str = ""

    def __post_init__(self) -> None:
        check_name(self.run_uid, "run_uid")
        check_label(self.test, "test")
        check_status(self.status)
        if self.seed is not None and not 0 <= self.seed < 2**63:
            raise ConfigError(f"seed {self.seed} is outside 0 to 2^63 - 1: choose a number within")
        for label, time in (("started_utc", self.started_utc), ("ended_utc", self.ended_utc)):
            if time or label == "started_utc":
                check_time(time, label)
        for label in ("configuration", "tool_version", "tool_commit"):
            check_text(getattr(self, label), label)
        check_note(self.note)
        check_text("".join(self.bench), "bench identity")
        for key, value in self.bench.items():
            if not (isinstance(key, str) and isinstance(value, str) and len(value) <= MAX_IDENTITY_CHARS):
                raise ConfigError(
                    f"bench identity '{key}' is {str(value)[:40]!r}: an identity holds texts of up to "
                    f"{MAX_IDENTITY_CHARS} characters and no parameters; remove it"
                )

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of the plan that was played; empty where the configuration is none of a plan of ours."""
        try:
            settings = json.loads(self.configuration).get("settings", {})
        except (ValueError, AttributeError, RecursionError):
            return {}
        return settings if isinstance(settings, dict) else {}


def check_status(status: str) -> None:
    """Raise ConfigError unless `status` is the open one or a final one."""
    if status not in (OPEN_STATUS, *FINAL_STATUSES):
        raise ConfigError(f"status '{status}' is unknown: use one of {', '.join(FINAL_STATUSES)}")


def check_time(text: str, what: str) -> None:
    """Raise ConfigError unless `text` is an ISO 8601 time with its zone."""
    try:
        time = datetime.fromisoformat(text)
        zone = time.tzinfo
        time.astimezone(UTC)  # it may lie before the first year or after the last there
    except (ValueError, OverflowError):
        zone = None
    if zone is None:
        raise ConfigError(f"{what} is {text[:40]!r}: write ISO 8601 with a zone, as in 2026-03-01T12:00:00+00:00")


def to_json(value: Mapping[str, Any], what: str) -> str:
    """Return `value` as JSON with sorted keys; numpy numbers and arrays become plain ones.

    Raises ConfigError when it holds anything else, or a number that is not finite.
    """
    try:
        return json.dumps(value, sort_keys=True, allow_nan=False, ensure_ascii=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{what} cannot be written as JSON ({error}): use finite numbers, texts, lists") from None


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):  # a read-only one, as the settings of a segment that was read
        return dict(value)
    raise TypeError(f"{type(value).__name__} is not a JSON type")


def segment_dtype(settings_bytes: int) -> np.dtype[Any]:
    """Return the row type of the segments table: texts of fixed length, so that a row is written in one location."""
    text = h5py.string_dtype
    return np.dtype(
        [
            ("label", text("utf-8", LABEL_BYTES)),
            ("start", "<i8"),
            ("stop", "<i8"),
            ("settings", text("utf-8", settings_bytes)),
        ]
    )
