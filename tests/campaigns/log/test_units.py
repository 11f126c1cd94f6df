"""The table of units against the definitions of the SI."""

import math

import pytest

from campaigns.log import UNITS, unit_named
from sim_backend.errors import ConfigError


@pytest.mark.parametrize(
    ("symbol", "value", "si_value", "si"),
    [
        ("mN m", 50.0, 0.05, "N m"),
        ("mrad", 4.5, 0.0045, "rad"),
        ("urad", 1.7, 1.7e-6, "rad"),
        ("µrad", 1.7, 1.7e-6, "rad"),
        ("nm", 30.0, 3e-8, "m"),
        ("um", 1.0, 1e-6, "m"),
        ("deg", 180.0, math.pi, "rad"),
        ("arcsec", 3600.0 * 180.0, math.pi, "rad"),
        ("arcmin", 60.0 * 180.0, math.pi, "rad"),
        ("rpm", 60.0, 2.0 * math.pi, "rad/s"),
        ("degC", -195.8, 77.35, "K"),
        ("%", 0.7, 0.007, "1"),
        ("N·m", 2.0, 2.0, "N m"),
        ("kHz", 10.0, 1e4, "Hz"),
    ],
)
def test_conversion(symbol, value, si_value, si):
    unit = unit_named(symbol)
    assert unit.si == si
    assert value * unit.factor + unit.offset == pytest.approx(si_value, rel=1e-14)


def test_every_unit_leads_to_a_coherent_one():
    for symbol, unit in UNITS.items():
        target = UNITS[unit.si]
        assert unit.symbol == symbol
        assert (target.si, target.factor, target.offset) == (target.symbol, 1.0, 0.0)


def test_an_unknown_unit_names_the_nearest_and_all():
    with pytest.raises(ConfigError) as caught:
        unit_named("mmrad")
    assert "did you mean 'mrad'?" in str(caught.value)
    assert all(symbol in str(caught.value) for symbol in UNITS)
