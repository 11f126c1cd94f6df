"""A known record in drawn units, clocks, forms and dialects comes back in SI, or is refused; never otherwise."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from campaigns.importing import import_run
from campaigns.importing.clock import SECONDS
from campaigns.log import read_run
from campaigns.log.units import UNITS
from sim_backend.errors import ConfigError, DataError

FORMS = ("csv", "txt", "npz", "npy")
CLOCKS = ("rate", *SECONDS, "date")
RATES_HZ = (1.0, 10.0, 250.0, 1000.0)


@st.composite
def records(draw: st.DrawFn) -> dict[str, Any]:
    rows = draw(st.integers(6, 40))
    seed = draw(st.integers(0, 2**31))
    drawn = {
        "values": np.random.default_rng(seed).standard_normal((rows, 2)) * 10.0 ** draw(st.integers(-3, 3)),
        "form": draw(st.sampled_from(FORMS)),
        "clock": draw(st.sampled_from(CLOCKS)),
        "named": draw(st.booleans()),
        "rate_hz": draw(st.sampled_from(RATES_HZ)),
        "units": [draw(st.sampled_from(sorted(UNITS))) for _ in range(2)],
        "units_below": draw(st.booleans()),
        "separator": draw(st.sampled_from([",", ";", "\t"])),
        "decimal": draw(st.sampled_from([".", ","])),
        "scale": draw(st.sampled_from([1.0, -2.0, 0.125])),
        "late_s": draw(st.sampled_from([0.0, 3.5])),
    }
    if drawn["clock"] == "date":
        drawn["form"] = "csv"
    if drawn["form"] == "npy":
        drawn["clock"] = "rate"
    return drawn


def stamps(drawn: dict[str, Any]) -> list[object]:
    seconds = drawn["late_s"] + np.arange(len(drawn["values"])) / drawn["rate_hz"]
    if drawn["clock"] == "date":
        start = np.datetime64("2026-11-25T11:00:00", "us")
        return [str(start + np.timedelta64(round(1e6 * s), "us")) for s in seconds]
    return (seconds / SECONDS[str(drawn["clock"])]).tolist()


def write(folder: Path, drawn: dict[str, Any]) -> tuple[str, dict[str, str]]:
    """Write the record and return the name of its file and how its columns are selected."""
    values, form, clock = drawn["values"], str(drawn["form"]), str(drawn["clock"])
    timed = clock != "rate"
    time_name = f"t ({clock})" if drawn["named"] and clock != "date" else "t"
    names = {"time": time_name, "u": "u", "y": "y"}
    path = folder / f"a.{form}"
    if form == "npy":
        np.save(path, values)
        return path.name, {"time": "", "u": "[:, 0]", "y": "[:, 1]"}
    if form == "npz":
        times: dict[str, Any] = {time_name: np.array(stamps(drawn))} if timed else {}
        np.savez(path, **times, u=values[:, 0], y=values[:, 1])
        return path.name, names
    separator, decimal = str(drawn["separator"]), str(drawn["decimal"])
    quote = '"' if separator == decimal else ""
    columns = [*([stamps(drawn)] if timed else []), values[:, 0].tolist(), values[:, 1].tolist()]
    heads = [*([time_name] if timed else []), "u", "y"]
    below = [*(["s" if clock == "date" else clock] if timed else []), *drawn["units"]]
    lines = [separator.join(heads), *([separator.join(below)] if drawn["units_below"] and clock != "date" else [])]
    for row in zip(*columns, strict=True):
        cells = [cell if isinstance(cell, str) else repr(cell).replace(".", decimal) for cell in row]
        lines.append(separator.join(f"{quote}{cell}{quote}" for cell in cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path.name, names


def comes_back(drawn: dict[str, Any]) -> bool:
    """Import what was drawn; tell whether it was read, having checked that it was read right."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        source, selected = write(folder, drawn)
        clock = str(drawn["clock"])
        unit = "" if clock in ("rate", "date") or drawn["named"] else f'time_unit = "{clock}"\n'
        given_clock = (
            f"sample_rate_hz = {drawn['rate_hz']}" if clock == "rate" else f'time = "{selected["time"]}"\n{unit}'
        )
        text = f'[log]\ntest = "t"\nsource = "{source}"\n{given_clock}\n'
        for channel, role, symbol in zip("uy", ("input", "output"), drawn["units"], strict=True):
            text += f'[channels.{channel}]\nselect = "{selected[channel]}"\nunit = "{symbol}"\nrole = "{role}"\n'
            text += f"scale = {drawn['scale']}\n"
        (folder / "map.toml").write_text(text, encoding="utf-8")
        try:
            made = import_run(folder / "map.toml", folder / "out.h5")
        except (DataError, ConfigError):
            return False
        assert made.sample_rate_hz == pytest.approx(drawn["rate_hz"], rel=1e-6)
        with read_run(folder / "out.h5") as run:
            for k, channel in enumerate("uy"):
                unit_ = UNITS[drawn["units"][k]]
                wanted = drawn["values"][:, k] * (drawn["scale"] * unit_.factor) + unit_.offset
                assert run.channels[channel].unit == unit_.si
                np.testing.assert_allclose(run.read(channel), wanted, rtol=1e-15, atol=0.0)
    return True


UNHURRIED: dict[str, Any] = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}


@settings(max_examples=60, **UNHURRIED)
@given(records())
def test_a_record_comes_back_in_si_or_is_refused(drawn: dict[str, Any]) -> None:
    comes_back(drawn)


@settings(max_examples=2_000, **UNHURRIED)
@given(records())
def test_two_thousand_records(drawn: dict[str, Any]) -> None:
    comes_back(drawn)


def test_ordinary_records_are_not_refused() -> None:
    rng = np.random.default_rng(5)
    for form in FORMS:
        for clock in CLOCKS:
            if (form == "npy" and clock != "rate") or (clock == "date" and form not in ("csv", "txt")):
                continue
            drawn = {"values": rng.standard_normal((20, 2)), "form": form, "clock": clock, "named": True}
            drawn |= {"rate_hz": 10.0, "units": ["mN m", "urad"], "units_below": False, "separator": ";"}
            drawn |= {"decimal": ".", "scale": 1.0, "late_s": 0.0}
            assert comes_back(drawn), (form, clock)
