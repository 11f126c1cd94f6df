"""A study as its file says it: one kind of trial, what is drawn at random, what is swept, how often.

The swept values form a grid, and every point of it gets the same draws: draw `d` gives the same bench and the same
noise at every point, so that strategies and settings are compared on the same benches. Trials are numbered draw by
draw: trial `d · points + p` is draw `d` at point `p`, so more draws only add trials behind those there are.
"""

from __future__ import annotations

import itertools
import math
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import msgspec

from campaigns.names import check_file_name
from sim_backend.documents import read_text, toml_of
from sim_backend.errors import ConfigError

SCHEMA = "mccd-study/1"
MAX_POINTS = 10_000
MAX_TRIALS = 10_000_000
"""Trials of a study over all points: its columns lie in memory when they are summarised."""
MODEL, SETTINGS = "model", "settings"

Swept = float | str | bool
"""What a sweep may set; whole numbers stay whole."""


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """Base of all tables: unknown fields are errors."""


class Normal(_Strict, frozen=True, kw_only=True):
    """A normal distribution; without `mean`, about the number that is there."""

    std: float
    mean: float | None = None


class Uniform(_Strict, frozen=True, kw_only=True):
    """A uniform distribution from `low` to `high`."""

    low: float
    high: float


class Variation(_Strict, frozen=True, kw_only=True):
    """What varies: a place, and either a distribution that is drawn from or the values of a sweep.

    `place` is `model` (its name), `model.` and the path to a number in it, or `settings.` and the name of a setting.
    With `relative` the numbers are relative changes: 0.01 makes it one per cent larger. Where a place
    means several numbers, each gets a draw of its own unless they change `together`; a sweep sets all alike.
    """

    place: str
    normal: Normal | None = None
    uniform: Uniform | None = None
    sweep: list[int | float | str | bool] | None = None
    relative: bool = False
    together: bool = False

    def __post_init__(self) -> None:
        given = [name for name in ("normal", "uniform", "sweep") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"`{self.place}` has {' and '.join(given) or 'nothing'}: give one of normal, uniform, sweep"
            )
        head, dot, rest = self.place.partition(".")
        if not (self.place == MODEL or (head in (MODEL, SETTINGS) and dot and rest)):
            raise ValueError(f"`{self.place}` is not a place: write model, model.<path to a number> or settings.<name>")
        if self.sweep is not None and not self.sweep:
            raise ValueError(f"`{self.place}` sweeps over nothing: give at least one value")
        if self.place == MODEL and (self.sweep is None or not all(isinstance(v, str) for v in self.sweep)):
            raise ValueError("`model` can only be swept, over names of models or files")
        numbers = [v for v in self._numbers() if isinstance(v, int | float)]
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"`{self.place}` holds a number that is not finite")
        if self.normal is not None and self.normal.std < 0.0:
            raise ValueError(f"`{self.place}` has std {self.normal.std:g}: it must be zero or more")
        if self.uniform is not None and self.uniform.low > self.uniform.high:
            raise ValueError(f"`{self.place}` has low above high: exchange them")
        texts = self.sweep is not None and any(isinstance(v, str | bool) for v in self.sweep)
        if texts and (self.relative or self.place.startswith(f"{MODEL}.")):
            raise ValueError(f"`{self.place}` can only take numbers")

    def _numbers(self) -> list[Any]:
        if self.normal is not None:
            return [self.normal.std, self.normal.mean or 0.0]
        return [self.uniform.low, self.uniform.high] if self.uniform is not None else list(self.sweep or ())


class Study(_Strict, frozen=True, kw_only=True, dict=True):
    """A whole study; `trials` is the number of draws, each of which is tried at every point of the grid.

    `settings` are those of the kind of trial, `limits` replace what its results are compared with.
    """

    schema: Literal["mccd-study/1"]
    name: str
    kind: str
    trials: int
    title: str = ""
    model: str = "as-built"
    seed: int = 0
    settings: dict[str, Any] = {}
    limits: dict[str, float] = {}
    vary: list[Variation] = []

    def __post_init__(self) -> None:
        if not 1 <= self.trials <= MAX_TRIALS:
            raise ValueError(f"`trials` is {self.trials}: give 1 to {MAX_TRIALS}")
        if not 0 <= self.seed < 2**63:
            raise ValueError(f"`seed` is {self.seed}: give 0 to 2^63 - 1")
        places = [v.place for v in self.vary]
        if len(set(places)) < len(places):
            raise ValueError("two [[vary]] have the same `place`: vary it once")
        if math.prod(len(v.sweep) for v in self.vary if v.sweep is not None) > MAX_POINTS:
            raise ValueError(f"the sweeps form a grid of more than {MAX_POINTS} points: sweep fewer values")
        if self.total > MAX_TRIALS:
            raise ValueError(
                f"{self.trials} draws at {len(self.points)} points are {self.total} trials, the limit is {MAX_TRIALS}: "
                "give fewer, or make several studies with other seeds"
            )

    @cached_property
    def points(self) -> list[dict[str, Swept]]:
        """The grid: the swept value of every swept place, the last place changing fastest; one point without sweeps."""
        swept = [(v.place, v.sweep) for v in self.vary if v.sweep is not None]
        return [
            dict(zip((place for place, _ in swept), values, strict=True))
            for values in itertools.product(*(values for _, values in swept))
        ]

    @property
    def total(self) -> int:
        """All trials: draws times points."""
        return self.trials * len(self.points)

    def models(self) -> list[str]:
        """Return the models that trials begin from, as they are named."""
        swept = next((v.sweep for v in self.vary if v.place == MODEL), None)
        return [str(name) for name in swept] if swept is not None else [self.model]


def load_study(path: str | Path) -> Study:
    """Return the study in a TOML file; raises ConfigError when there is none or it says something that cannot be."""
    return parse_study(read_text(Path(path), "study", fix="name the file of a study"), str(path))


def parse_study(text: str, where: str) -> Study:
    """Return the study written in `text`; `where` names it in errors, which are as those of `load_study`."""
    try:
        study = msgspec.convert(toml_of(text, where), Study)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {error}; see docs/studies.md for the fields") from None
    check_file_name(study.name, f"{where}: name")  # that of its folder, where none is given
    return study
