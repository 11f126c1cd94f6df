"""Text files that people write and programs keep, as TOML or JSON: whatever they hold, what cannot be read is reported.

Every loader begins here, so that all of them refuse the same: what is not a file, is too large, is not UTF-8, nests too
deeply or holds a number that no program keeps exactly. What the content has to be is each loader's own.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from sim_backend.errors import ConfigError, MccdError
from sim_backend.small_files import TOML_BYTES, read_small_text

MOST_LEVELS = 64
"""Depth of nested lists and tables: what walks a document in Python comes to its end at about a thousand."""

_WHOLE_NUMBERS = range(-(2**63), 2**63)
"""Whole numbers of TOML, and of all that is computed with them."""


class SyntaxFault(ConfigError):  # noqa: N818 it is reported as the error that it is
    """The text is not what TOML allows at all."""


def read_text(
    path: Path, what: str, *, most_bytes: int = TOML_BYTES, error: type[MccdError] = ConfigError, fix: str = ""
) -> str:
    """Return the text of a file, which messages call `what`.

    Raises `error`, with the `fix`, for a path without a file, more than `most_bytes`, and text that is not UTF-8.
    """
    try:
        return read_small_text(path, most_bytes)
    except (FileNotFoundError, NotADirectoryError):
        raise error(f"{what} '{path}': no such file{fix and '; '}{fix}") from None
    except UnicodeDecodeError as fault:
        raise error(f"{path}: not UTF-8 text at byte {fault.start}; save the {what} as UTF-8") from None
    except ValueError as fault:  # a name with a zero byte
        raise error(f"{what} '{path}': no name of a file ({fault}); correct it") from None
    except OSError as fault:
        raise error(f"{path}: {fault.strerror}; name the file of a {what}") from None


def toml_of(text: str, where: str, fix: str = "mend that line") -> dict[str, Any]:
    """Return what TOML text says; raises ConfigError naming `where`, with the `fix`, for what is none or too deep."""
    import tomllib

    if any(_names(line) > MOST_LEVELS for line in text.splitlines() if line.count(".") >= MOST_LEVELS):
        raise _too_deep(where, ConfigError)
    try:
        # line ends as a file that is opened as text has them
        found = tomllib.loads(text.replace("\r\n", "\n").replace("\r", "\n"))
    except tomllib.TOMLDecodeError as fault:
        raise SyntaxFault(f"{where}: not valid TOML: {fault}; {fix}") from None
    except RecursionError:
        raise _too_deep(where, ConfigError) from None
    except ValueError as fault:
        raise ConfigError(f"{where}: not valid TOML: {fault}; mend that number") from None
    _require_plain(found, where, ConfigError)
    return found


def _names(line: str) -> int:
    """Return how many names the longest dotted key of a line has; reading them takes the square of that."""
    *before, _ = line.split("=") if not line.lstrip().startswith("[") or "=" in line else (line, "")
    return max((part.replace("{", ",").rpartition(",")[2].count(".") + 1 for part in before), default=0)


def json_of(text: str, where: str, *, error: type[MccdError], fix: str = "correct it there") -> Any:
    """Return what JSON text says; raises `error` naming `where`, with the `fix`, for what is none or too deep."""
    import json

    try:
        found = json.loads(text)
    except RecursionError:
        raise _too_deep(where, error) from None
    except ValueError as fault:
        raise error(f"{where}: not valid JSON: {fault}; {fix}") from None
    _require_plain(found, where, error)
    return found


def _require_plain(content: object, where: str, error: type[MccdError]) -> None:
    """Raise `error` for lists and tables that nest too deeply, and for whole numbers of more than 64 bits."""
    level: list[object] = [content] if isinstance(content, dict | list) else []
    for _ in range(MOST_LEVELS + 1):
        inner: list[object] = []
        for node in level:
            for part in node.values() if isinstance(node, dict) else cast(list[object], node):
                if isinstance(part, dict | list):
                    inner.append(part)
                elif isinstance(part, int) and part not in _WHOLE_NUMBERS:
                    shown = f"{float(part):.3g}" if abs(part) < 10**300 else "of more than 300 digits"
                    raise error(f"{where}: holds the whole number {shown}; the limit is 64 bits, mend it")
        if not inner:
            return
        level = inner
    raise _too_deep(where, error)


def _too_deep(where: str, error: type[MccdError]) -> MccdError:
    return error(f"{where}: lists or tables nest more than {MOST_LEVELS} levels deep; make it flat")
