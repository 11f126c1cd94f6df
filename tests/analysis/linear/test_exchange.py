"""Models and responses in the hands of other packages: the same poles, the same response, there and back."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
import scipy.signal

from analysis.identification.response_curves import ResponseCurve
from analysis.identification.response_files import load_response, save_response
from analysis.linear.exchange import from_control, from_scipy, to_control, to_scipy
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import discretise
from sim_backend.model import dump_model, load_model, parse_model

F = np.geomspace(1.0, 2000.0, 60)
RATE_HZ = 1e4


@pytest.fixture
def model(plant, rng):
    return plant(rng, 3, 2, 2, mechanical=False)


def close(found, expected):
    # both sides evaluate rational functions of order 6 whose poles span two decades: rounding times their conditioning
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-10 * np.abs(expected).max())


def test_control_evaluates_the_response_that_the_model_has(model):
    # python-control and scipy compute it from the matrices, the model from its blocks
    system = to_control(model)
    close(np.moveaxis(system(2j * np.pi * F), -1, 0), model.frequency_response(F))
    back = from_control(system)
    close(back.frequency_response(F), model.frequency_response(F))
    np.testing.assert_allclose(np.sort(back.omega_rad_s), np.sort(model.omega_rad_s), rtol=1e-9)


def test_a_transfer_function_of_control_becomes_a_model():
    found = from_control(control.tf([3092.0], [1.0, 2 * 4.8, (2 * np.pi * 29.56) ** 2]))
    assert found.omega_rad_s[0] / (2 * np.pi) == pytest.approx(29.56, rel=1e-12)
    assert found.sigma_1_s[0] == pytest.approx(4.8, rel=1e-10)
    s = 2j * np.pi * F
    close(found.frequency_response(F)[:, 0, 0], 3092.0 / (s**2 + 9.6 * s + (2 * np.pi * 29.56) ** 2))


def test_scipy_there_and_back(model):
    system = to_scipy(model)
    s = 2j * np.pi * F[:, None, None]
    expected = (
        system.C @ np.linalg.solve(s * np.eye(6) - system.A, np.broadcast_to(system.B, (F.size, 6, 2))) + system.D
    )
    close(expected, model.frequency_response(F))
    close(from_scipy(system).frequency_response(F), model.frequency_response(F))
    zpk = scipy.signal.ZerosPolesGain([-10.0], [-3 + 200j, -3 - 200j], 5.0)
    close(from_scipy(zpk).frequency_response(F)[:, 0, 0], scipy.signal.freqresp(zpk, 2 * np.pi * F)[1])


def test_a_sampled_model_keeps_its_rate(model):
    sampled = discretise(model, RATE_HZ)
    system = to_control(sampled)
    assert system.dt == 1.0 / RATE_HZ
    close(np.moveaxis(system(np.exp(2j * np.pi * F / RATE_HZ)), -1, 0), sampled.frequency_response(F))
    assert to_scipy(sampled).dt == 1.0 / RATE_HZ
    with pytest.raises(ConfigError, match="sampled every 0.0001 s"):
        from_control(system)
    with pytest.raises(ConfigError, match="sampled every 0.0001 s"):
        from_scipy(to_scipy(sampled))


def test_a_delay_is_not_dropped_in_silence(model):
    with pytest.raises(ConfigError, match="input 1 has a delay"):
        to_control(model.with_(delay_s=np.array([0.0, 1e-4])))


def test_a_model_is_the_same_in_json(tmp_path):
    model = load_model("as-built")
    text = dump_model(model, "json")
    assert text.startswith("{") and parse_model(text, "here") == model
    (tmp_path / "m.json").write_text(text, encoding="utf-8")
    assert load_model(tmp_path / "m.json") == model
    with pytest.raises(ConfigError, match="not valid JSON"):
        parse_model("{ name = 1", "here")
    with pytest.raises(ConfigError, match="docs/model-file.md"):
        parse_model('{"name": 3}', "here")


def curves(ports: int) -> tuple[ResponseCurve, ...]:
    rng = np.random.default_rng(ports)
    names = ["torque_x", "torque_y", "force_z"][:ports]
    outs = ["theta_x", "theta_y", "z"][:ports]
    made = []
    for o in outs:
        for i in names:
            magnitude, std = rng.uniform(1e-6, 1e2, (2, F.size))
            made.append(ResponseCurve(o, i, F, magnitude, rng.uniform(-3.1, 3.1, F.size), std, 0.5 * std))
    return tuple(made)


@pytest.mark.parametrize("ports", [1, 2, 3])
@pytest.mark.parametrize("form", ["csv", "touchstone"])
def test_a_response_comes_back_from_its_file(tmp_path, ports, form):
    path = tmp_path / ("r.csv" if form == "csv" else f"r.s{ports}p")
    save_response(curves(ports), path)
    for found, given in zip(load_response(path), curves(ports), strict=True):
        assert (found.output, found.input) == (given.output, given.input)
        np.testing.assert_array_equal(found.frequency_hz, given.frequency_hz)
        # real and imaginary part and back: a few roundings
        np.testing.assert_allclose(found.magnitude, given.magnitude, rtol=1e-14)
        np.testing.assert_allclose(found.phase_rad, given.phase_rad, rtol=0, atol=1e-14)
        assert np.array_equal(found.std, given.std) if form == "csv" else np.all(np.isnan(found.std))


def test_names_in_a_table_are_no_formulas_and_come_back(tmp_path):
    (given,) = curves(1)
    given = replace(given, output="=1+1", input="@x")
    save_response((given,), tmp_path / "r.csv")
    assert "\n'=1+1,'@x," in (tmp_path / "r.csv").read_text()
    (found,) = load_response(tmp_path / "r.csv")
    assert (found.output, found.input) == ("=1+1", "@x")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("# kHz S DB R 50\n1.5 20 90\n", 10.0 * 1j),
        ("! made elsewhere\n# Hz S MA R 50\n1500 10 90 ! remark\n", 10.0 * 1j),
        ("# MHz RI\n0.0015 0 10\n", 10.0 * 1j),
    ],
)
def test_touchstone_of_others_is_read(tmp_path, text, expected):
    (tmp_path / "r.s1p").write_text(text)
    (found,) = load_response(tmp_path / "r.s1p")
    assert found.frequency_hz[0] == pytest.approx(1500.0) and (found.output, found.input) == ("output 1", "input 1")
    assert found.magnitude[0] * np.exp(1j * found.phase_rad[0]) == pytest.approx(expected)


def test_two_ports_stand_in_the_order_that_others_write(tmp_path):
    (tmp_path / "r.s2p").write_text("# Hz S RI R 50\n1 11 0 21 0 12 0 22 0\n")
    found = {(c.output, c.input): c.magnitude[0] for c in load_response(tmp_path / "r.s2p")}
    assert found["output 2", "input 1"] == 21.0 and found["output 1", "input 2"] == 12.0


def test_what_is_no_response_is_refused_in_one_line(tmp_path):
    for name, text in (("r.csv", "a,b\n1,2\n"), ("r.s1p", "1 2\n"), ("r.txt", ""), ("r.s1p", "# Hz\nx y z\n")):
        (tmp_path / name).write_text(text)
        with pytest.raises(DataError, match=name) as found:
            load_response(tmp_path / name)
        assert "\n" not in str(found.value)
    with pytest.raises(ConfigError, match=r"\.s2p"):
        save_response(curves(2), tmp_path / "new.s3p")
    with pytest.raises(ConfigError, match="not a (known format|format)"):
        save_response(curves(1), tmp_path / "new.txt")
