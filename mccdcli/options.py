"""The options that commands have in common, each written once."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import click

from sim_backend.errors import did_you_mean

F = TypeVar("F", bound=Callable[..., Any])

BENCHES: Final = ("sim[:MODEL]", "emulator[:MODEL]", "serial:DEVICE[@BAUD]", "tcp:HOST:PORT")


class BenchAddress(click.ParamType[str]):
    """An address of one of the formats in BENCHES: its format is checked, its text passed on."""

    name = "bench"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return `value` if it has the format of a bench address, else end with a usage error."""
        address = str(value)
        kind, colon, rest = address.partition(":")
        host, _, port = rest.rpartition(":")
        port_fits = port.isdecimal() and 0 < int(port) < 65536
        faults = {
            "sim": "MODEL is missing behind the colon." if colon and not rest else "",
            "emulator": "MODEL is missing behind the colon." if colon and not rest else "",
            "serial": "" if rest else "DEVICE is missing.",
            "tcp": "HOST is missing." if not host else "" if port_fits else f"PORT is {port!r}; it is 1 to 65535.",
        }
        fault = faults.get(kind, did_you_mean(kind, faults).capitalize())
        if fault or kind not in faults:
            self.fail(f"{address!r} is not a bench; a bench is {', '.join(BENCHES)}. {fault}".rstrip(), param, ctx)
        return address

    def risk_of(self, value: Any) -> str:
        """Say what a default from somebody else's file would do, nothing where that is harmless."""
        return "" if str(value).partition(":")[0] in ("sim", "emulator") else "that opens a line to a bench"


class NewPath(click.Path):
    """Where something is to be written: a path of UTF-8 text, as files that name other files hold nothing else."""

    def __init__(self, *, dir_okay: bool = True) -> None:
        super().__init__(path_type=Path, dir_okay=dir_okay)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return `value` as a Path, or end with a usage error."""
        try:
            str(value).encode("utf-8")
        except UnicodeEncodeError:
            self.fail(f"{str(value)!r} holds bytes that are no UTF-8 text; choose a name that is", param, ctx)
        return super().convert(value, param, ctx)

    def risk_of(self, value: Any) -> str:
        """Say what a default from somebody else's file would do, nothing where that is harmless."""
        inside = Path(str(value)).resolve().is_relative_to(Path.cwd())
        return "" if inside else "that writes outside this folder"


_MOST: Final = 2**63 - 1
"""Largest whole number: what logs, databases and random numbers keep."""


class Real(click.types.FloatParamType):
    """A finite number."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, else end with a usage error."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class RealRange(Real, click.FloatRange):
    """A finite number in a range; click's own lets through what is not a number."""


class Percent(RealRange):
    """A share as `3%`, kept as a fraction; limits are in percent. Without `%` it could be either, and is refused."""

    name = "percent"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the fraction, else end with a usage error."""
        text = str(value).strip()
        percent = Real().convert(text.removesuffix("%").rstrip(), param, ctx)
        if not text.endswith("%"):
            self.fail(f"{text} may be a fraction or percent; write {100.0 * percent:.12g}% or {text}%.", param, ctx)
        return super().convert(percent, param, ctx) / 100.0


class WholeRange(click.IntRange):
    """A whole number in a range, and of 64 bits."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number, else end with a usage error."""
        number: int = super().convert(value, param, ctx)
        if not -_MOST <= number <= _MOST:
            self.fail(f"a whole number may have 64 bits, up to {_MOST}.", param, ctx)
        return number


_NOTE: Final = f"{__name__}.note"


def _keep_note(ctx: click.Context, _param: click.Parameter, note: str) -> None:
    """Keep a note for `given_note`, or end with a usage error for one that no log could hold."""
    if note:
        from campaigns.log.limits import check_note

        check_note(note)
        ctx.meta[_NOTE] = note


def given_note() -> str:
    """Return the note that the running command was given, empty where none was."""
    note: str = click.get_current_context().meta.get(_NOTE, "")
    return note


POSITIVE: Final = RealRange(0.0, min_open=True)

FRF_HELP: Final = (
    "Read a frequency-response table instead of logs: columns 'frequency (Hz)', 'magnitude (rad/N m)' and "
    "'phase (deg)', or real and imaginary part; 'level' may follow."
)

OPTIONS: Final[dict[str, Callable[[F], F]]] = {
    "bench": click.option(
        "--bench",
        type=BenchAddress(),
        envvar="MCCD_BENCH",
        default="sim",
        show_default=True,
        metavar="BENCH",
        help=f"Where to run: {', '.join(BENCHES)}. MODEL is as-built and BAUD 115200 unless given.",
    ),
    "out": click.option("-o", "--out", type=NewPath(), metavar="PATH", help="Where to write the result."),
    "seed": click.option(
        "--seed",
        envvar="MCCD_SEED",
        type=WholeRange(min=0),
        default=0,
        show_default=True,
        metavar="N",
        help="Seed of everything random.",
    ),
    "dry_run": click.option(
        "--dry-run", is_flag=True, help="Check and show what would be done (steps, limits, duration, bytes), then stop."
    ),
    "note": click.option(
        "--note",
        default="",
        expose_value=False,
        callback=_keep_note,
        metavar="TEXT",
        help="Note on this run: kept in its log, shown in lists and on pages.",
    ),
    "json": click.option(
        "--json",
        "as_json",
        is_flag=True,
        help="Result as JSON on standard output, all else on standard error.",
    ),
}


def without_option(command: F) -> F:
    """Decorator that adds `--without EFFECT`, which the command receives as `without`: tuple[str, ...]."""
    return click.option(
        "--without",
        multiple=True,
        metavar="EFFECT",
        help="Effect to leave out of the search; repeatable. `mccd model effects` lists them.",
    )(command)


def existing_file(name: str, nargs: int = 1, metavar: str | None = None) -> Callable[[F], F]:
    """Decorator that adds the argument `name`: a file to read (Path), or with `nargs` -1 one or more of them."""
    kind = click.Path(exists=True, dir_okay=False, path_type=Path)
    return click.argument(name, type=kind, nargs=nargs, metavar=metavar, required=True)


def common_options(*names: str) -> Callable[[F], F]:
    """Decorator that adds the options of these names, in the order of OPTIONS; without a name, all of them.

    The command receives them as `bench`: str, `out`: Path | None, `seed`: int, `dry_run`: bool, `as_json`: bool;
    whatever records a log asks `given_note`.
    """
    unknown = set(names) - set(OPTIONS)
    if unknown:
        raise ValueError(f"no common option {sorted(unknown)}; there are {list(OPTIONS)}")

    def decorate(command: F) -> F:
        for name, option in reversed(OPTIONS.items()):
            if not names or name in names:
                command = option(command)
        return command

    return decorate
