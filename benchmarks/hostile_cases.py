"""Hostile command lines, option values and files, drawn from a seed: what `soak_hostile` feeds every command with."""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import click

from benchmarks.hostile_files import NUMBERS, TEXTS, changed, write
from mccdcli.main import cli

FILES = (
    "folder", "empty", "binary", "long", "deep", "link", "loop", "unreadable", "missing/x", "run.h5",
    "model.toml", "data.csv",
    "campaign.toml", "study.toml", "map.toml", "score.json", "played/campaign.json", "new/out.h5", "out.h5", "out.csv",
    "out.mat", "out.svg", "out.json", "out.toml", "\udcff.h5", "a" * 300, "folder/out.npz", "/dev/null",
)  # fmt: skip

BASES: tuple[tuple[str, ...], ...] = (
    ("bench", "list"),
    ("bench", "check", "--bench", "sim"),
    ("bench", "serve", "--transport", "pty", "--faults", "no-such-fault"),
    ("campaign", "list"),
    ("campaign", "run", "campaign.toml", "--dry-run"),
    ("campaign", "run", "campaign.toml", "-o", "again"),
    ("campaign", "run", "campaign.toml", "-o", "played", "--resume"),
    ("campaign", "show", "campaign.toml"),
    ("campaign", "show", "played"),
    # of one family: one of each are minutes of honest work, a hundred times
    ("challenge", "make", "blind", "--one", "0", "--none", "0", "--family", "delay", "--shape", "short"),
    ("challenge", "pool", "score.json"),
    ("challenge", "score", "hidden"),
    ("challenge", "run", "hidden", "--from", "0009"),
    ("chop", "--dry-run"),
    ("chop", "--frequency", "5", "--cycles", "2", "--set", "window_s=0.05", "-o", "chop.h5"),
    ("chop", "--cycles", "2", "--strategy", "designed", "--controller", "designed/controller.toml", "-o", "chop.h5"),
    ("compare", "run.h5", "rest.h5"),
    ("compare", "model.toml", "design", "-o", "compared.html"),
    ("completion", "bash"),
    ("config", "show", "chop"),
    ("design", "--model", "design", "--unswept", "-o", "designed", "--dry-run"),
    ("diagnose", "rest.h5", "--model", "nominal.toml", "--rows", "1000"),
    ("diagnose", "--frf", "response.csv", "--model", "nominal.toml", "--level", "7"),
    ("endstops", "--dry-run"),
    ("endstops", "--set", "hold_s=0.1", "--set", "ramp_s=0.05", "--set", "settle_s=0.05"),
    ("hysteresis", "--dry-run"),
    ("hysteresis", "--set", "frequency_hz=20", "--set", "offsets_rad=[]", "--set", "torques_nm=[0.02]"),
    ("identify", "--dry-run", "-o", "new.toml"),
    ("identify", "--log", "run.h5", "-o", "fit.toml", "--only", "theta_x"),
    ("identify", "--frf", "response.csv", "--rate", "1000", "--modes", "1", "-o", "fit.toml"),
    ("import", "map.toml", "-o", "imported.h5"),
    ("import", "map-npz.toml", "-o", "imported-npz.h5"),
    ("import", "map-npy.toml", "-o", "imported-npy.h5"),
    ("import", "data.csv", "--guess", "-o", "guessed.toml"),
    ("investigate", "--model", "nominal.toml", "--dry-run"),
    ("log", "check", "run.h5"),
    ("log", "export", "rest.h5", "-o", "rest.csv"),
    ("log", "list", "."),
    ("log", "plot", "rest.h5"),
    ("log", "recover", "rest.h5", "-o", "recovered.h5"),
    ("log", "show", "run.h5"),
    ("log", "summary", "run.h5"),
    ("log", "verify", "run.h5", "rest.h5"),
    ("manual",),
    ("model", "convert", "model.toml", "-o", "model.json"),
    ("model", "effects", "coulomb-friction"),
    ("report", "--campaign", "campaign.toml", "--dry-run"),
    ("report", "--campaign", "campaign.toml", "--no-design", "-o", "played"),
    ("schema", "chop"),
    ("settle", "--dry-run"),
    ("settle", "--cycles", "2", "-o", "settle.h5"),
    ("simulate", "--model", "model.toml", "--plan", "rest", "--set", "duration_s=0.1", "-o", "sim.h5"),
    ("simulate", "--plan", "freerun", "--dry-run"),
    ("simulate", "--plan", "multisine", "--dry-run"),
    ("simulate", "--plan", "sinesweep", "--dry-run"),
    ("simulate", "--plan", "theodolite", "--dry-run"),
    ("simulate", "--plan", "thermal", "--dry-run"),
    ("simulate", "--plan", "hysteresis", "--dry-run"),
    ("simulate", "--waveform", "wave.csv", "-o", "sim.h5"),
    ("study", "study.toml", "--dry-run"),
    ("study", "study.toml", "-o", "studied", "--resume"),
    ("study", "study.toml", "-o", "new", "--workers", "1"),
    ("theodolite", "--dry-run"),
    ("theodolite", "--readings", "readings.csv", "--dry-run"),
    ("thermal", "--dry-run"),
    ("watch", "rest.h5", "--once"),
    ("watch", "rest.h5", "--once", "--model", "nominal.toml"),
)
"""Sound command lines that end within a second or two; each is the start of many that are not sound."""

PLAYS = tuple(base for base in BASES if base[0] in ("chop", "settle", "simulate") and "-o" in base)
"""Those that write what a bench gives, and so show whether its compiled code is what it was."""

KERNELS = "kernels"
"""Folder beside that of a case, from which it takes compiled code where it is there; `soak_hostile` fills it."""


def commands_of(arguments: tuple[str, ...]) -> click.Command:
    """Return the command that a sound command line runs."""
    words = next(arguments[:n] for n in (2, 1) if arguments[:n] in cli.paths())
    found = cli.find(words)
    assert found is not None
    return found


class Drawn(NamedTuple):
    """A case: a command line, what is done to the files in its folder before it, and that in words.

    `checked` says that only bytes with a digest beside them are changed, of logs or of compiled code: what comes out,
    if anything does, is what comes out without the change.
    """

    arguments: list[str]
    changes: list[Callable[[], None]]
    told: str
    checked: bool


def sound(seed: int) -> Drawn:
    """Return the sound command line that the case of a seed begins with."""
    return Drawn(list(BASES[seed % len(BASES)]), [], "sound", checked=True)


def drawn(seed: int) -> Drawn:
    """Return the case of a seed."""
    rng = random.Random(seed)
    base = BASES[seed % len(BASES)]
    arguments, changes, told = list(base), list[Callable[[], None]](), list[str]()
    if base in PLAYS and rng.random() < 0.25:
        return Drawn(arguments, [_cache(rng.random())], "damaged machine code", checked=True)
    for _ in range(rng.choice((1, 1, 1, 1, 2, 3))):
        kind = rng.random()
        if kind < 0.4:
            told.append(_option(arguments, base, rng))
        elif kind < 0.46:
            told.append(_argument(arguments, base, rng))
        elif kind < 0.54:
            name, change = _settings(base, rng)
            changes.append(change)
            told.append(name)
        elif kind < 0.6:
            name, change = _beside(arguments, rng)
            changes.append(change)
            told.append(name)
        else:
            name, change = _file(arguments, rng)
            changes.append(change)
            told.append(name)
    logs = all(name.endswith((".h5 changed", ".h5.sha256 changed")) for name in told)
    return Drawn(arguments, changes, "; ".join(told), checked=logs)


def _option(arguments: list[str], base: tuple[str, ...], rng: random.Random) -> str:
    """Add an option with a hostile value, of the kind that it takes or of another."""
    command = commands_of(base)
    options = [
        p for p in command.params if isinstance(p, click.Option) and p.name not in ("workers", "jobs", "cluster")
    ]
    if not options:
        return "nothing"
    option = rng.choice(options)
    name = max(option.opts, key=len)
    if option.is_flag:
        arguments.append(rng.choice([name, *option.secondary_opts]))
        return arguments[-1]
    value = _value(option, arguments, rng)
    arguments += [name, value]
    return f"{name} {value[:40]!r}"


def _value(option: click.Option, arguments: list[str], rng: random.Random) -> str:
    if option.name == "settings":
        return f"{_setting(arguments, rng)}={rng.choice(NUMBERS + TEXTS)}"
    if option.name in ("bench", "address"):
        some = ("sim:model.toml", "sim:", "sim:folder", "serial:/dev/null", "tcp:127.0.0.1:1", "emulator:no")
        return rng.choice(some + TEXTS)
    if isinstance(option.type, click.Path) or rng.random() < 0.2:
        return rng.choice(FILES)
    return rng.choice(NUMBERS + (TEXTS if rng.random() < 0.4 else ()))


def _setting(arguments: list[str], rng: random.Random) -> str:
    """Return a setting of any plan, mostly one of the plan at hand."""
    from campaigns.plans import PLANS

    plans = {plan.name: plan for plan in (PLANS.values() if isinstance(PLANS, dict) else PLANS)}
    own = {"chop": "chop", "settle": "settling", "identify": "sinesweep"} | {n: n for n in plans}
    at_hand = [plans[own[word]] for word in arguments if word in own and own[word] in plans]
    plan = at_hand[-1] if at_hand and rng.random() < 0.9 else rng.choice(list(plans.values()))
    return str(rng.choice([*plan.__struct_fields__, "no_such", "tuning"]))


def _argument(arguments: list[str], base: tuple[str, ...], rng: random.Random) -> str:
    """Put something hostile in place of a word."""
    at = rng.randrange(len(base))
    arguments[at] = rng.choice(FILES + TEXTS + NUMBERS)
    return f"word {at + 1} is {arguments[at][:40]!r}"


def _settings(base: tuple[str, ...], rng: random.Random) -> tuple[str, Callable[[], None]]:
    """Return what writes a hostile mccd.toml."""
    command = commands_of(base)
    table = ".".join(base[:2] if base[:2] in cli.paths() else base[:1])
    names = [max(p.opts, key=len).removeprefix("--") for p in command.params if isinstance(p, click.Option)]
    where = rng.choice([f"[{table}]", f"[{table}]", "[defaults]", "[no]", "", f"[[{table}]]", f"[{table}.x]"])
    key = rng.choice([*names, "bench", "seed", "no"])
    value = rng.choice(NUMBERS + TEXTS + ('"text"', '["a", "b"]', "[[[1]]]", "{ a = { b = 1 } }", "true"))
    text = f"{where}\n{key} = {value}\n"
    return f"mccd.toml with {text[:60]!r}", lambda: write(Path("mccd.toml"), text.encode("utf-8", "surrogatepass"))


def _file(arguments: list[str], rng: random.Random) -> tuple[str, Callable[[], None]]:
    """Return what damages one of the files that a command line names, or of those in a folder that it names."""
    named = [Path(word) for word in arguments if word and len(word) < 200 and "\0" not in word]
    files = [Path("mccd.toml")] if not named else []
    for path in (*named, Path(".")) if rng.random() < 0.1 else named:
        try:
            files += [p for p in sorted(path.rglob("*")) if p.is_file()] if path.is_dir() else [path] * path.is_file()
        except OSError:
            continue
    files = [file for file in files if not file.is_fifo() and str(file) not in ("unreadable", "/dev/null")]
    if not files:
        return "nothing", lambda: None
    file, seed = rng.choice(files), rng.random()
    return f"{file} changed", lambda: changed(file, random.Random(seed))


def _cache(seed: float) -> Callable[[], None]:
    """Return what damages some of the compiled code."""

    def damage() -> None:
        rng = random.Random(seed)
        files = sorted(file for file in Path("..", KERNELS).rglob("*") if file.is_file())
        for file in rng.sample(files, rng.randrange(1, 4)):
            content = bytearray(file.read_bytes() or b"0")
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
            other = rng.choice(files).read_bytes()
            damaged = (bytes(content), bytes(content), bytes(content[: len(content) // 2]), b"", other)
            write(file, rng.choice(damaged))

    return damage


OURS = (
    "index.html", "report.json", "diagnosis.json", "explore.json", "study.json", "trials.csv", "trials.sqlite",
    "trials.sqlite-journal", "trials.sqlite-wal", "campaign.json", ".campaign.lock", "campaign", "designed", "figures",
    "controller.toml", "design.json", "extended.toml", "run-1.h5", "run-1.h5.sha256", "rest.h5.sha256", "results",
)  # fmt: skip
"""Names that commands give to what they write, and that libraries look for beside it."""


def _beside(arguments: list[str], rng: random.Random) -> tuple[str, Callable[[], None]]:
    """Return what puts a link or a pipe where a command, or a library of it, would read or write."""
    folders = [Path(word) for word in arguments if word in ("played", "studied", "hidden", "report", "small", "mine")]
    folder, kind = rng.choice([*folders, Path(".")]), rng.choice(("../elsewhere", "..", "pipe"))
    path = folder / rng.choice(OURS)

    def put() -> None:
        path.parent.mkdir(exist_ok=True)
        if path.is_dir() and not path.is_symlink():
            return
        path.unlink(missing_ok=True)
        if kind == "pipe":
            os.mkfifo(path)
        else:
            path.symlink_to(os.path.join(*[".."] * len(folder.parts), kind))

    return f"{path} is {'a pipe' if kind == 'pipe' else f'a link to {kind}'}", put
