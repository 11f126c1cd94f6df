"""Benches by address: `sim`, `emulator`, `serial:DEVICE` … BENCHES is the only list; every test runs on all."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sim_backend.bench import Bench
from sim_backend.errors import ConfigError
from sim_backend.model import bundled_models, dump_model, load_model

DEFAULT_MODEL = "as-built"


@dataclass(frozen=True)
class BenchKind:
    """One way to reach a bench: `open` takes the address after the colon, a seed and the level of the disturbance.

    A bench that is not simulated has its own disturbance, whatever the level. `digest` distinguishes two benches at the
    same address. A `repeatable` bench gives the same record for the same seed. Of a bench that is `many`, each opening
    gives another one, so that several can play at once.
    """

    form: str
    help: str
    open: Callable[[str, int, float], Bench]
    digest: Callable[[str], str]
    repeatable: bool
    many: bool = False


def _open_simulated(address: str, seed: int, disturbance: float) -> Bench:
    # a kind of bench is imported when one is opened: each brings a good part of the project
    model = address or DEFAULT_MODEL
    loaded = load_model(model)
    from sim_backend.simbench import SimBench

    return SimBench(loaded, seed, name=simulated_name(model), disturbance=disturbance)


def simulated_name(model: str | Path) -> str:
    """Return the name of the bench that a bundled model or a file simulates: that of either, without its ending."""
    return str(model) if str(model) in bundled_models() else Path(model).stem


def _model_digest(address: str) -> str:
    return hashlib.sha256(dump_model(load_model(address or DEFAULT_MODEL)).encode()).hexdigest()


def _open_emulated(address: str, seed: int, disturbance: float) -> Bench:
    from campaigns.serial import EmulatedBench, ServeOptions

    return EmulatedBench(ServeOptions(bench=f"sim:{address or DEFAULT_MODEL}", seed=seed, disturbance=disturbance))


def _open_at(kind: str) -> Callable[[str, int, float], Bench]:
    def opened(address: str, _seed: int, _disturbance: float) -> Bench:
        from campaigns.serial import SerialBench, transport_at

        return SerialBench(transport_at(kind, address), kind)

    return opened


def _told_by_identity(_address: str) -> str:
    """A bench at the end of a line says who it is, and that is part of every run's fingerprint."""
    return "by its identity"


BENCHES: dict[str, BenchKind] = {
    "sim": BenchKind(
        "sim[:MODEL]",
        f"simulated in this process: the model '{DEFAULT_MODEL}', or another bundled one or a file",
        _open_simulated,
        _model_digest,
        repeatable=True,
        many=True,
    ),
    "emulator": BenchKind(
        "emulator[:MODEL]",
        "the same simulated bench behind firmware and serial protocol, in a process of its own",
        _open_emulated,
        _model_digest,
        repeatable=True,
    ),
    "serial": BenchKind(
        "serial:DEVICE[@BAUD]",
        "a bench at a serial port, as in serial:/dev/ttyUSB0@921600; 115200 baud unless given",
        _open_at("serial"),
        _told_by_identity,
        repeatable=False,
    ),
    "tcp": BenchKind("tcp:HOST:PORT", "a bench on the network", _open_at("tcp"), _told_by_identity, repeatable=False),
}


def bench_kind(address: str) -> tuple[BenchKind, str]:
    """Return the kind of a bench and what stands after the colon; raises ConfigError naming the kinds there are."""
    name, _, rest = address.partition(":")
    if name not in BENCHES:
        forms = ", ".join(kind.form for kind in BENCHES.values())
        raise ConfigError(f"there is no bench '{address}'; benches: {forms}")
    return BENCHES[name], rest


def open_bench(address: str, seed: int, disturbance: float = 1.0) -> Bench:
    """Return the bench at `address`, at rest, a simulated one with its disturbance at a level.

    Raises ConfigError for an address or model that does not exist, and for a level that cannot be.
    """
    kind, rest = bench_kind(address)
    return kind.open(rest, seed, disturbance)
