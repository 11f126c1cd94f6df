"""The errors and warnings of the project: every message says what happened, the value, the limit and the fix."""

from collections.abc import Iterable


class MccdError(Exception):
    """An error that a user can act on; `exit_code` is what the command line ends with."""

    exit_code = 1


class CheckError(MccdError):
    """A test or a check was carried out and failed (exit code 1)."""

    exit_code = 1


class ConfigError(MccdError):
    """The command line, a model, a plan or a map requests something impossible (exit code 2)."""

    exit_code = 2


class HardwareError(MccdError):
    """A bench did not do what it was told, or said that it could not (exit code 3)."""

    exit_code = 3


class DataError(MccdError):
    """A file or its data cannot be used as they are (exit code 4)."""

    exit_code = 4


class MccdWarning(UserWarning):
    """Something that a user should know and results do not suffer from; the command line shows it as one line."""


_LEAST_BEGUN = 2
"""Letters of a beginning that says nothing yet."""


def nearest(name: str, known: Iterable[str], most: int) -> list[str]:
    """Return the known names that are nearest to `name`, or else those whose beginning it is, at most so many."""
    from difflib import get_close_matches  # only errors need it

    names = list(known)
    begun = sorted((k for k in names if len(name) > _LEAST_BEGUN and k.startswith(name)), key=len)
    return (get_close_matches(name, names, n=most) or begun)[:most]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return "did you mean 'x'? " for the known name that is nearest to `name`, or nothing where none is near."""
    near = nearest(name, known, 1)
    return f"did you mean '{near[0]}'? " if near else ""
