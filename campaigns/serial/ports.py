"""Where the emulated bench can be reached: a pseudo-terminal with a lasting name, or a TCP port."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import tempfile
import tty
from pathlib import Path
from typing import Protocol

from sim_backend.errors import ConfigError, HardwareError
from sim_backend.safe_write import give_name, hidden_name


class Channel(Protocol):
    """An open line: non-blocking, readable and writable by number."""

    def fileno(self) -> int:
        """The number to wait on."""

    def read(self, count: int) -> bytes | None:
        """Return up to `count` bytes, None when there are none; raises OSError or EOFError when the line is gone."""

    def write(self, data: bytes) -> int:
        """Write what fits now and return how much that was; raises OSError when the line is gone."""

    def close(self) -> None:
        """Let it go."""


class Port(Protocol):
    """Where lines come from."""

    @property
    def address(self) -> str:
        """How a client names it: `serial:PATH` or `tcp:HOST:PORT`."""

    def fileno(self) -> int | None:
        """The number to wait on for a new line, None when there is nothing to wait for."""

    def accept(self) -> Channel | None:
        """Return a new line if there is one."""

    def close(self) -> None:
        """Let it go."""


class PtyPort:
    """A pseudo-terminal behind a symbolic link, so that the name outlasts a dropped line as a device's name does."""

    def __init__(self, link: Path | None = None) -> None:
        self._folder = None if link else tempfile.TemporaryDirectory(prefix="mccd-bench-")
        self._link = link or Path(self._folder.name if self._folder else "") / "tty"
        if os.path.lexists(self._link) and not _leads_to_terminal(self._link):
            raise ConfigError(f"{self._link} exists and leads to no terminal; choose another name for the terminal")
        self._link.unlink(missing_ok=True)
        self._line: PtyChannel | None = None

    @property
    def address(self) -> str:
        """`serial:` and the lasting name."""
        return f"serial:{self._link}"

    def fileno(self) -> int | None:
        """Nothing to wait for: a terminal is always there."""
        return None

    def accept(self) -> Channel | None:
        """Return a new terminal, unless the last one is still open."""
        if self._line is not None and not self._line.closed:
            return None
        self._line = PtyChannel(self._link)
        return self._line

    def close(self) -> None:
        """Remove the name."""
        self._link.unlink(missing_ok=True)
        if self._folder is not None:
            self._folder.cleanup()


def _leads_to_terminal(link: Path) -> bool:
    """Tell whether `link` is one that a bench left or may replace: to a terminal that is there, or was."""
    return link.is_symlink() and os.readlink(link).startswith("/dev/")


class PtyChannel:
    """A raw pseudo-terminal named `link`; its slave end is held open so that a client may come and go."""

    def __init__(self, link: Path) -> None:
        self._link = link
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        fresh = hidden_name(link)
        fresh.symlink_to(os.ttyname(self._slave))
        give_name(fresh, link, replace=True)
        self.closed = False

    def fileno(self) -> int:
        """The master end."""
        return self._master

    def read(self, count: int) -> bytes | None:
        """Return what the host wrote."""
        with contextlib.suppress(BlockingIOError):
            return os.read(self._master, count)
        return None

    def write(self, data: bytes) -> int:
        """Write towards the host."""
        with contextlib.suppress(BlockingIOError):
            return os.write(self._master, data)
        return 0

    def close(self) -> None:
        """Hang up; first the name, for the terminal's number may be another bench's in a moment."""
        self.closed = True
        self._link.unlink(missing_ok=True)
        os.close(self._slave)
        os.close(self._master)


class TcpPort:
    """A listening TCP port; port 0 takes a free one."""

    def __init__(self, host: str, port: int) -> None:
        try:
            family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
            self._socket = socket.create_server((host, port), family=family)
        except OSError as error:
            raise HardwareError(f"cannot listen on {host}:{port} ({error.strerror}); choose another port") from None
        self._socket.setblocking(False)

    @property
    def address(self) -> str:
        """`tcp:HOST:PORT` with the port that was taken."""
        host, port = self._socket.getsockname()[:2]
        return f"tcp:[{host}]:{port}" if ":" in host else f"tcp:{host}:{port}"

    def fileno(self) -> int | None:
        """The listening socket."""
        return self._socket.fileno()

    def accept(self) -> Channel | None:
        """Return a new connection if there is one."""
        try:
            connection, _ = self._socket.accept()
        except (BlockingIOError, ConnectionError):
            return None
        return TcpChannel(connection)

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()


class TcpChannel:
    """One TCP connection."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._socket = connection

    def fileno(self) -> int:
        """The socket."""
        return self._socket.fileno()

    def read(self, count: int) -> bytes | None:
        """Return what the host sent; EOFError when it has hung up."""
        try:
            data = self._socket.recv(count)
        except BlockingIOError:
            return None
        if not data:
            raise EOFError
        return data

    def write(self, data: bytes) -> int:
        """Send towards the host."""
        with contextlib.suppress(BlockingIOError):
            return self._socket.send(data)
        return 0

    def close(self) -> None:
        """Hang up."""
        self._socket.close()
