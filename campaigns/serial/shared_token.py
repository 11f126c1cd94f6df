"""The secret that a bench and its hosts share: from a file or a variable of the environment, never the command line."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from sim_backend.errors import ConfigError

TOKEN = "MCCD_BENCH_TOKEN"
TOKEN_FILE = "MCCD_BENCH_TOKEN_FILE"
LEAST, MOST = 16, 512
"""How many characters a token has."""


def shared_token(file: Path | None = None) -> bytes | None:
    """Return the token in `file`, else in the variable TOKEN, else in the file that TOKEN_FILE names; None without.

    Raises ConfigError for one that is too short to be a secret, and for a file that others may read.
    """
    if file is None and (text := os.environ.get(TOKEN)):
        return _checked(text, TOKEN)
    name = file or os.environ.get(TOKEN_FILE)
    return None if not name else _checked(_read(Path(name)), str(name))


def _read(path: Path) -> str:
    try:
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # a pipe would be waited for without end
        with open(number, "rb") as file:
            found = os.fstat(number)
            if not stat.S_ISREG(found.st_mode):
                raise ConfigError(f"token file {path}: it is not a file; write the token into one")
            if found.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
                raise ConfigError(f"token file {path}: other users may read or write it; run chmod 600 on it")
            return file.read(4 * MOST).decode("ascii", "replace")
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"token file {path}: cannot be read ({getattr(error, 'strerror', None) or error}); correct --token-file "
            f"or {TOKEN_FILE}"
        ) from None


def _checked(text: str, where: str) -> bytes:
    token = text.strip()
    if not LEAST <= len(token) <= MOST or not token.isascii() or not token.isprintable():
        raise ConfigError(
            f"{where}: a token of {len(token)} characters; it needs {LEAST} to {MOST} of ASCII, as from 'openssl rand "
            "-hex 32'"
        )
    return token.encode("ascii")
