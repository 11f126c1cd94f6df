"""The kinds of trial. KINDS is the only list: adding a kind is one file and one line here."""

from __future__ import annotations

from analysis.study.kinds.base import Column, Kind, Scalar, Setup
from analysis.study.kinds.chop import ChopTrial
from analysis.study.kinds.diagnosis import DiagnosisTrial
from analysis.study.kinds.endstops import EndstopsTrial
from analysis.study.kinds.hysteresis import HysteresisTrial
from analysis.study.kinds.settling import SettlingTrial
from analysis.study.kinds.theodolite import TheodoliteTrial
from analysis.study.kinds.thermal import ThermalTrial
from sim_backend.errors import ConfigError, did_you_mean

KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        ChopTrial(),
        DiagnosisTrial(),
        EndstopsTrial(),
        HysteresisTrial(),
        SettlingTrial(),
        TheodoliteTrial(),
        ThermalTrial(),
    )
}


def kind_named(name: str) -> Kind:
    """Return a kind of trial; raises ConfigError naming those there are."""
    if name not in KINDS:
        raise ConfigError(f"there is no kind of trial '{name}'; {did_you_mean(name, KINDS)}kinds: {', '.join(KINDS)}")
    return KINDS[name]


__all__ = ["KINDS", "Column", "Kind", "Scalar", "Setup", "kind_named"]
