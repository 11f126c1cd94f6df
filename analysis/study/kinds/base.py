"""What a kind of trial is: what it measures, and how one trial is done. KINDS in the package is the only list."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Literal, TypeVar

from sim_backend.model import Model

T = TypeVar("T")

Scalar = float | bool | str | None
"""One result; None where it was not measured."""


@dataclass(frozen=True)
class Column:
    """One result of a trial: its name (with unit), what it is, and the largest allowed value if it has one."""

    name: str
    about: str
    kind: Literal["number", "flag", "text"] = "number"
    limit: float | None = None


@dataclass(frozen=True)
class Setup:
    """One trial: the bench as drawn, the same before anything was drawn, the settings at its point, and its seed."""

    bench: Model
    nominal: Model
    settings: Mapping[str, Any]
    seed: int


class Kind(ABC):
    """One kind of trial. A trial is pure: what it returns follows from its setup alone."""

    name: ClassVar[str]
    title: ClassVar[str]
    columns: ClassVar[tuple[Column, ...]]

    @abstractmethod
    def decides(self, setup: Setup) -> Mapping[str, Any]:
        """Return what decides a trial besides model and settings, such as the text of a design model.

        Raises ConfigError for settings that cannot be; asked at every point before the first trial.
        """

    @abstractmethod
    def run(self, setup: Setup) -> Mapping[str, Scalar]:
        """Return the results of one trial by column; raises MccdError when the trial comes to none."""

    def run_together(self, setups: Sequence[Setup]) -> list[Mapping[str, Scalar] | Exception]:
        """Return the results of trials, or what each of them met: the same as of each alone.

        Raises OSError and MemoryError, which are of no trial.
        """
        return [attempted(partial(self.run, setup)) for setup in setups]


def attempted(act: Callable[[], T]) -> T | Exception:
    """Return what `act` returns, or what it raises; raises OSError and MemoryError, which are of no trial."""
    try:
        return act()
    except (OSError, MemoryError):
        raise
    except Exception as error:
        return error
