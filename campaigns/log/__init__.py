"""Logs of runs: one HDF5 file each, written so that it survives a kill, read so that it cannot do harm."""

from campaigns.log.checksum import sha256_of, sidecar_of
from campaigns.log.probe import read_run
from campaigns.log.read import Run, Window
from campaigns.log.recover import Recovery, recover
from campaigns.log.schema import FINAL_STATUSES, HELD_OUT, ROLES, SCHEMA, Channel, Header, LogSegment
from campaigns.log.units import UNITS, Unit, unit_named
from campaigns.log.verify import Check, VerifyReport, verify
from campaigns.log.write import LogWriter

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
