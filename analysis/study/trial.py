"""One trial of a study: what is drawn for it, what it is set up with, and what comes of it.

A trial follows from the study and its number alone: its random numbers come from the study's seed and the number of
its draw, never from what ran before it or beside it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal
from zlib import crc32

import msgspec
import numpy as np

from analysis.study.definition import MODEL, Study, Swept, Variation
from analysis.study.kinds import Column, Kind, Scalar, Setup, kind_named
from analysis.study.kinds.base import attempted
from analysis.study.places import Number, numbers_at, replaced
from sim_backend.errors import ConfigError, MccdError, did_you_mean
from sim_backend.model import Model, check_model, load_model

Content = dict[str, Any]

MAX_COLUMNS = 1500

DRAWS_KEPT = 64
"""Benches that are kept for the other points of their draw, which the threads need at almost the same time."""


@dataclass(frozen=True)
class Outcome:
    """What came of one trial.

    `done` has `results`; `failed` came to none for a reason that follows from its setup (a bench that is unstable, a
    setting that cannot be); `broken` met an error that nobody foresaw. `varied` holds what was drawn and swept.
    """

    trial: int
    status: Literal["done", "failed", "broken"]
    reason: str
    varied: tuple[Scalar, ...]
    results: tuple[Scalar, ...]
    wall_s: float


@dataclass(frozen=True)
class Job:
    """A study with everything that its trials need: the models that they begin from, as plain content."""

    study: Study
    models: Mapping[str, Content]

    @classmethod
    def of(cls, study: Study) -> Job:
        """Return the job of a study; raises ConfigError for models, places and limits that do not fit together."""
        kind = kind_named(study.kind)
        known = [c.name for c in kind.columns if c.kind == "number"]
        for name in study.limits:
            if name not in known:
                raise ConfigError(
                    f"[limits] names '{name}', which is not a number of a trial of kind '{kind.name}'; "
                    f"{did_you_mean(name, known)}its numbers are {', '.join(known)}"
                )
        job = cls(study, {name: msgspec.to_builtins(load_model(name)) for name in study.models()})
        names = job.varied_names
        if len(names) > MAX_COLUMNS:
            raise ConfigError(f"{len(names)} numbers vary, at most {MAX_COLUMNS} may; name fewer places")
        twice = next((name for i, name in enumerate(names) if name in names[:i]), None)
        if twice is not None:
            raise ConfigError(f"two [[vary]] change '{twice}'; let their places mean different numbers")
        return job

    def __reduce__(self) -> tuple[type[Job], tuple[Study, Mapping[str, Content]]]:
        return Job, (self.study, self.models)  # without what is worked out from them

    @cached_property
    def kind(self) -> Kind:
        """The kind of its trials."""
        return kind_named(self.study.kind)

    @cached_property
    def nominals(self) -> dict[str, Model]:
        """The models before anything is drawn."""
        return {name: msgspec.convert(content, Model) for name, content in self.models.items()}

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """The results of a trial, with the limits of this study."""
        return tuple(Column(c.name, c.about, c.kind, self.study.limits.get(c.name, c.limit)) for c in self.kind.columns)

    @cached_property
    def places(self) -> dict[tuple[str, str], list[Number]]:
        """The numbers that each place means in each model; raises ConfigError where models differ in them."""
        found = {}
        for one in self.study.vary:
            head, _, way = one.place.partition(".")
            if head != MODEL or not way:
                continue
            for model, content in self.models.items():
                found[model, one.place] = numbers_at(content, way)
            names = {tuple(n.name for n in found[model, one.place]) for model in self.models}
            if len(names) > 1:
                raise ConfigError(
                    f"place '{one.place}' means different numbers in {', '.join(self.models)}; name them one by one"
                )
        return found

    @cached_property
    def varied_names(self) -> tuple[str, ...]:
        """The names of all numbers and settings that vary, in the order of the file."""
        first = next(iter(self.models))
        return tuple(
            name
            for one in self.study.vary
            for name in (
                [f"{MODEL}.{n.name}" for n in self.places[first, one.place]]
                if (first, one.place) in self.places
                else [one.place]
            )
        )

    def point(self, trial: int) -> dict[str, Swept]:
        """Return the swept values of a trial."""
        return self.study.points[trial % len(self.study.points)]

    def setup(self, trial: int, varied: tuple[Scalar, ...]) -> Setup:
        """Return what a trial is set up with; raises ConfigError when what was drawn makes no model."""
        point, study = self.point(trial), self.study
        name = str(point.get(MODEL, study.model))
        settings, values, drawn = dict(study.settings), iter(varied), list[float]()
        for one in study.vary:
            if numbers := self.places.get((name, one.place)):
                drawn += [_number(value, one) for _, value in zip(numbers, values, strict=False)]
            elif one.place == MODEL:
                next(values)
            else:
                settings = _set(settings, one.place.split(".")[1:], next(values))
        bench = self._bench(name, np.array(drawn).tobytes())  # every bit counts: 0.0 == -0.0 would not tell them apart
        return Setup(bench, self.nominals[name], settings, _seed(study.seed, trial // len(study.points)))

    @cached_property
    def _bench(self) -> Callable[[str, bytes], Model]:
        """Makes the model `name` with all its places at the float64 numbers in `drawn`: once for all points of a draw.

        Raises ConfigError when that is not a model.
        """

        @lru_cache(maxsize=DRAWS_KEPT)
        def made(name: str, drawn: bytes) -> Model:
            content, values = self.models[name], iter(np.frombuffer(drawn).tolist())
            for one in self.study.vary:
                for number in self.places.get((name, one.place), ()):
                    content = replaced(content, number.way, next(values))
            return _checked(content, name)

        return made

    def undrawn(self, point: int) -> Setup:
        """Return the setup at a point of the grid before anything is drawn; raises ConfigError for an absurd sweep."""
        study = self.study
        still = msgspec.structs.replace(study, vary=[v for v in study.vary if v.sweep is not None])
        job = Job(still, self.models)
        return job.setup(point, job.varied(point))

    def varied(self, trial: int) -> tuple[Scalar, ...]:
        """Return every number and setting of a trial that varies, in the order of `varied_names`."""
        point, study = self.point(trial), self.study
        model, key = str(point.get(MODEL, study.model)), _key(study.seed, trial // len(study.points))
        out: list[Scalar] = []
        for one in study.vary:
            numbers = self.places.get((model, one.place))
            if one.sweep is not None:
                own = [n.value for n in numbers] if numbers else [self._setting(one)]
                out += [_swept(point[one.place], x, one) for x in own]
                continue
            own = [n.value for n in numbers] if numbers else [self._setting(one)]
            rng = np.random.default_rng([*key, crc32(one.place.encode())])
            out += _drawn(one, own, rng)
        return tuple(out)

    def _setting(self, one: Variation) -> Any:
        """Return what the file sets at the place of a setting, None where it sets nothing."""
        node: Any = self.study.settings
        for key in one.place.split(".")[1:]:
            node = node.get(key) if isinstance(node, Mapping) else None
        return node


@lru_cache(maxsize=DRAWS_KEPT)
def _key(seed: int, draw: int) -> tuple[int, ...]:
    """Return the words that all randomness of a draw is made from."""
    return tuple(np.random.SeedSequence(seed, spawn_key=(draw,)).generate_state(4).tolist())


def _seed(seed: int, draw: int) -> int:
    """Return the seed of a draw's bench, below 2^63."""
    low, high, *_ = _key(seed, draw)
    return int(low | (high & 0x7FFF_FFFF) << 32)


def _swept(value: Swept, own: Any, one: Variation) -> Scalar:
    if not one.relative:
        return value
    return _number(own, one) * (1.0 + float(value))


def _drawn(one: Variation, own: list[Any], rng: np.random.Generator) -> list[float]:
    """Return one draw for each of the numbers that are there."""
    size = 1 if one.together else len(own)
    if one.uniform is not None:
        drawn = one.uniform.low + (one.uniform.high - one.uniform.low) * rng.random(size)
        about = False
    else:
        assert one.normal is not None
        drawn = one.normal.std * rng.standard_normal(size) + (one.normal.mean or 0.0)
        about = one.normal.mean is None
    drawn = np.broadcast_to(drawn, len(own))
    if one.relative:
        return [_number(x, one) * (1.0 + float(d)) for x, d in zip(own, drawn, strict=True)]
    return [(_number(x, one) if about else 0.0) + float(d) for x, d in zip(own, drawn, strict=True)]


def _number(own: Any, one: Variation) -> float:
    if not isinstance(own, int | float) or isinstance(own, bool):
        raise ConfigError(f"'{one.place}' is {own!r} in the study, so nothing can lie about it; set it, or give a mean")
    return float(own)


def _set(settings: dict[str, Any], keys: list[str], value: Scalar) -> dict[str, Any]:
    """Return the settings with one replaced; missing tables on its path are created."""
    below = settings.get(keys[0])
    inner = value if len(keys) == 1 else _set(below if isinstance(below, dict) else {}, keys[1:], value)
    return {**settings, keys[0]: inner}


def _checked(content: Content, name: str) -> Model:
    try:
        model = msgspec.convert(content, Model)
    except msgspec.ValidationError as error:
        raise ConfigError(f"model {name} as drawn: {error}") from None
    check_model(model, f"model {name} as drawn")
    return model


def run_trial(job: Job, trial: int) -> Outcome:
    """Return what comes of a trial; as `run_trials`."""
    return run_trials(job, (trial,))[0]


def run_trials(job: Job, trials: Sequence[int]) -> list[Outcome]:
    """Return what comes of trials, whatever that is, in their order: the same for each whichever others there are.

    Only what lies outside the trials is raised: a disk, a file or memory that fails (OSError, MemoryError).
    """
    started = time.perf_counter()
    begun = [_set_up(job, trial) for trial in trials]
    results = iter(job.kind.run_together([setup for _, setup in begun if isinstance(setup, Setup)]))
    found = [next(results) if isinstance(setup, Setup) else setup for _, setup in begun]
    wall_s = (time.perf_counter() - started) / max(len(trials), 1)
    return [
        _ended(job, trial, varied, one, wall_s) for trial, (varied, _), one in zip(trials, begun, found, strict=True)
    ]


def _set_up(job: Job, trial: int) -> tuple[tuple[Scalar, ...], Setup | Exception]:
    """Return what varies in a trial and what it is set up with, or why it cannot be."""
    varied = attempted(lambda: job.varied(trial))
    if isinstance(varied, Exception):
        return (None,) * len(job.varied_names), varied
    return varied, attempted(lambda: job.setup(trial, varied))


def _ended(
    job: Job, trial: int, varied: tuple[Scalar, ...], found: Mapping[str, Scalar] | Exception, wall_s: float
) -> Outcome:
    if not isinstance(found, Exception):
        return Outcome(trial, "done", "", varied, tuple(found[c.name] for c in job.columns), wall_s)
    empty: tuple[Scalar, ...] = (None,) * len(job.columns)
    if isinstance(found, MccdError):
        return Outcome(trial, "failed", " ".join(str(found).split()), varied, empty, wall_s)
    # a trial that met a bug is a result too: the others go on, and the study says so
    return Outcome(trial, "broken", " ".join(f"{type(found).__name__}: {found}".split()), varied, empty, wall_s)
