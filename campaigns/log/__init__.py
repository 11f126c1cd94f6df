"""Logs of runs: one HDF5 file each, written so that it survives a kill, read so that it cannot do harm.

What the package offers is loaded when it is first asked for: a process that reads for another needs little of it, and
every start of one is waited for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from campaigns.log.checksum import sha256_of, sidecar_of
    from campaigns.log.probe import read_run
    from campaigns.log.read import Run, Window
    from campaigns.log.recovery import Recovery, recover
    from campaigns.log.schema import FINAL_STATUSES, HELD_OUT, ROLES, SCHEMA, Channel, Header, LogSegment
    from campaigns.log.units import UNITS, Unit, unit_named
    from campaigns.log.verification import Check, VerifyReport, verify
    from campaigns.log.write import LogWriter

_PLACES = {
    "FINAL_STATUSES": "schema",
    "HELD_OUT": "schema",
    "ROLES": "schema",
    "SCHEMA": "schema",
    "UNITS": "units",
    "Channel": "schema",
    "Check": "verification",
    "Header": "schema",
    "LogSegment": "schema",
    "LogWriter": "write",
    "Recovery": "recovery",
    "Run": "read",
    "Unit": "units",
    "VerifyReport": "verification",
    "Window": "read",
    "read_run": "probe",
    "recover": "recovery",
    "sha256_of": "checksum",
    "sidecar_of": "checksum",
    "unit_named": "units",
    "verify": "verification",
}

__all__ = [
    "FINAL_STATUSES",
    "HELD_OUT",
    "ROLES",
    "SCHEMA",
    "UNITS",
    "Channel",
    "Check",
    "Header",
    "LogSegment",
    "LogWriter",
    "Recovery",
    "Run",
    "Unit",
    "VerifyReport",
    "Window",
    "read_run",
    "recover",
    "sha256_of",
    "sidecar_of",
    "unit_named",
    "verify",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'campaigns.log' has no attribute {name!r}")
    found = getattr(import_module(f"campaigns.log.{_PLACES[name]}"), name)
    globals()[name] = found  # from now on found at once
    return found
