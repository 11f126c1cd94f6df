"""Defaults that a user has set: two TOML files, read before the command line and overruled by it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import click

from sim_backend.errors import ConfigError, did_you_mean

PREFIX: Final = "MCCD"
"""The variable PREFIX_COMMAND_OPTION sets an option, named by its long name; MCCD_BENCH and MCCD_SEED hold for all."""

EXPLICIT: Final = f"{PREFIX}_CONFIG"
FOR_ALL: Final = "defaults"
SHARED: Final = ("bench", "seed")
"""What the table [defaults] may hold, for every command that has the option."""

HERE: Final = Path("mccd.toml")

_LIFTED: Final = {
    "allow-outside": "that lets maps read files outside their folder",
    "allow-remote": "that opens a bench to other machines",
    "force": "that replaces what is there",
    "host": "that opens a bench to other machines",
    "token-file": "that decides who may command a bench",
}
"""Options that lift a limit for whoever sets them, with what they do."""


@dataclass(frozen=True)
class Settings:
    """What the files say: `values` as nested tables by command and option.

    `origins` has the file that set each, by its key path (command, …, option).
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    origins: Mapping[tuple[str, ...], Path] = field(default_factory=dict)

    def table(self, command: tuple[str, ...]) -> Mapping[str, Any]:
        """Return what the files say of a command, by option."""
        found: Any = self.values
        for word in command:
            found = found.get(word, {})
        return found if isinstance(found, dict) else {}


def places() -> tuple[Path, ...]:
    """Return the files that are read, the one that overrules the others last."""
    if explicit := os.environ.get(EXPLICIT):
        return (Path(explicit),)
    own = _own()
    return (HERE,) if own is None else (own, HERE)


def _own() -> Path | None:
    """Return the user's own file; None where neither the environment nor the system tells of a home."""
    try:
        home = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    except RuntimeError:
        return None
    return Path(home) / "mccd" / "config.toml"


def load_settings(groups: Mapping[str, str], commands: Mapping[str, object]) -> Settings:
    """Return what the files say; raises ConfigError for one that is not TOML or names a command that there is not."""
    values: dict[str, Any] = {}
    origins: dict[tuple[str, ...], Path] = {}
    for path in places():
        if path.exists():
            _merge(values, _read(path), path, origins)
        elif os.environ.get(EXPLICIT):
            raise ConfigError(f"{EXPLICIT} names {path}, which is not a file; correct or unset it")
    known = {name.partition(" ")[0] for name in commands} | {FOR_ALL}
    for name, part in values.items():
        where = next(origins[key] for key in origins if key[0] == name)
        if not isinstance(part, dict):
            raise ConfigError(f"{where}: '{name}' is in no table; write it below [{FOR_ALL}] or below [COMMAND]")
        if name not in known:
            raise ConfigError(
                f"{where}: there is no command '{name}'; {did_you_mean(name, known)}a table has a command's name"
            )
        for word in part if name in groups else ():
            if f"{name} {word}" not in commands:
                below = [c.partition(" ")[2] for c in commands if c.startswith(f"{name} ")]
                raise ConfigError(
                    f"{where}: there is no command '{name} {word}'; {did_you_mean(word, below)}there are "
                    f"{', '.join(sorted(below))}"
                )
    for name in values.get(FOR_ALL, {}):
        if name not in SHARED:
            raise ConfigError(
                f"{origins[FOR_ALL, name]}: [{FOR_ALL}] holds '{name}'; {did_you_mean(name, SHARED)}it may hold "
                f"{', '.join(SHARED)}; write others in the table of their command"
            )
    return Settings(values, origins)


def defaults_of(settings: Settings, command: click.Command, path: tuple[str, ...]) -> dict[str, Any]:
    """Return the defaults of a command by the names of its parameters.

    Raises ConfigError for an option that it does not have.
    """
    options = dict(options_of(command))
    # an option of the same name and another meaning has a variable of its own
    common = settings.table((FOR_ALL,)).items()
    shared = {n: v for n, v in common if n in options and options[n].envvar == f"{PREFIX}_{n.upper()}"}
    own = {name.replace("_", "-"): value for name, value in settings.table(path).items()}
    _refuse_from_the_folder(settings, options, path)
    for name in own:
        if name not in options:
            where = next(file for key, file in settings.origins.items() if key[:-1] == path and same(key[-1], name))
            raise ConfigError(
                f"{where}: '{' '.join(path)}' has no option '{name}'; {did_you_mean(name, options)}there are "
                f"{', '.join(sorted(options))}"
            )
    given = {str(options[name].name): (options[name], value) for name, value in (shared | own).items()}
    return {name: _as_typed(option, value) for name, (option, value) in given.items()}


def _as_typed(option: click.Option, value: Any) -> Any:
    """Return a value of a file in the format of the command line; raises ConfigError for another."""
    if option.multiple and isinstance(value, list):
        return [_as_typed_once(option, one) for one in value]
    return _as_typed_once(option, value)


def _as_typed_once(option: click.Option, value: Any) -> Any:
    fits = isinstance(value, bool) if option.is_flag else isinstance(value, str | int | float)
    if not fits or (isinstance(value, bool) and not option.is_flag):
        wanted = "true or false" if option.is_flag else "a text or a number"
        given = f"{max(option.opts, key=len)} as {str(value)[:60]}, a {type(value).__name__}"
        raise ConfigError(f"the settings give {given}; it takes {wanted}")
    return value if isinstance(value, bool) else str(value)


def options_of(command: click.Command) -> Iterator[tuple[str, click.Option]]:
    """Yield every option of a command with its long name."""
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            long = [name for name in parameter.opts if name.startswith("--")]
            if long:
                yield long[0].removeprefix("--"), parameter


def name_variables(command: click.Command, prefix: str) -> None:
    """Name the variable of every option PREFIX_OPTION after its long name, unless it has one already.

    Click also reads the variable that is named after the parameter in Python, where nothing else is set.
    """
    for name, option in options_of(command):
        if option.envvar is None:
            option.envvar = f"{prefix}_{name.replace('-', '_').upper()}"


def _refuse_from_the_folder(settings: Settings, options: Mapping[str, click.Option], path: tuple[str, ...]) -> None:
    """Raise ConfigError for what `mccd.toml` of the current folder may not set: whoever made the folder wrote it."""
    if os.environ.get(EXPLICIT):
        return  # the user has named the file
    for key, file in settings.origins.items():
        name = key[-1].replace("_", "-")
        if file == HERE and key[:-1] in (path, (FOR_ALL,)) and name in options:
            value: Any = settings.table(key[:-1])[key[-1]]
            why = _LIFTED.get(name) or getattr(options[name].type, "risk_of", lambda _: "")(value)
            if why:
                raise ConfigError(
                    f"{file} sets {'.'.join(key)} = {value!r}, and {why}: a file of the current folder may not, as "
                    f"others may have put it there; move the line to {_own()}, or give --{name}"
                )


def same(first: str, second: str) -> bool:
    """Return whether both name the same option."""
    return first.replace("_", "-") == second.replace("_", "-")


def _read(path: Path) -> dict[str, Any]:
    from sim_backend.documents import read_text, toml_of  # few folders hold settings

    return toml_of(read_text(path, "settings"), str(path))


def _merge(
    into: dict[str, Any], new: Mapping[str, Any], path: Path, origins: dict[tuple[str, ...], Path], *above: str
) -> None:
    for name, value in new.items():
        if isinstance(value, dict):
            origins.setdefault((*above, name), path)
            if not isinstance(into.get(name), dict):  # the other file may say something else by that name
                into[name] = {}
            _merge(into[name], value, path, origins, *above, name)
        else:
            into[name] = value
            origins[*above, name] = path
