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

from campaigns.serial.addresses import Address
from sim_backend.errors import ConfigError, HardwareError
from sim_backend.safe_write import give_name, hidden_name

_TERMINALS = "/dev/pts/"


class Channel(Protocol):
    """An open line: non-blocking, readable and writable by number."""

    @property
    def peer(self) -> str:
        """Who is at its other end."""

    def fileno(self) -> int:
        """The number to wait on."""

    def read(self, count: int) -> bytes | None:
        """Return up to `count` bytes, None if none has arrived.

        Raises OSError for an error of the port, EOFError when the other end has closed it.
        """

    def write(self, data: bytes) -> int:
        """Write what fits now and return how much that was; raises OSError when the line is gone."""

    def close(self) -> None:
        """Let it go."""


class Port(Protocol):
    """Where lines come from."""

    @property
    def is_network(self) -> bool:
        """Whether any program can connect, a browser too, so that a line has to begin with a greeting."""

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
        try:
            self._folder = None if link else tempfile.TemporaryDirectory(prefix="mccd-bench-")
        except OSError as error:
            raise ConfigError(f"no folder for the terminal's name ({error.strerror}); set TMPDIR or --link") from None
        self._link = link or Path(self._folder.name if self._folder else "") / "tty"
        _require_free(self._link)
        self._line: PtyChannel | None = None

    @property
    def is_network(self) -> bool:
        """A terminal has one line, and its user's rights guard it."""
        return False

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
        """Remove its folder, if it made one."""
        if self._folder is not None:
            self._folder.cleanup()


class PtyChannel:
    """A raw pseudo-terminal named `link`; its slave end is held open so that a client may come and go."""

    def __init__(self, link: Path) -> None:
        self._link = link
        try:
            self._master, self._slave = pty.openpty()
        except OSError as error:
            raise HardwareError(
                f"no pseudo-terminal is to be had ({error.strerror}); end programs that hold some"
            ) from None
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._name = os.ttyname(self._slave)
        try:
            _point(link, self._name)
        except (OSError, ConfigError):
            self._let_go()
            raise
        self.closed = False

    @property
    def peer(self) -> str:
        """The lasting name."""
        return str(self._link)

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
        with contextlib.suppress(OSError):
            if os.readlink(self._link) == self._name:  # else somebody has put another thing there
                self._link.unlink()
        self._let_go()

    def _let_go(self) -> None:
        os.close(self._slave)
        os.close(self._master)


def _require_free(link: Path) -> None:
    """Raise ConfigError unless nothing is at `link`, or what another bench may have left: the name of a terminal."""
    with contextlib.suppress(OSError):
        if os.readlink(link).startswith(_TERMINALS):
            return
    if os.path.lexists(link) or not link.name:
        raise ConfigError(
            f"{link} exists and is not a symbolic link to a terminal; choose another name for the terminal"
        )


def _point(link: Path, terminal: str) -> None:
    """Make `link` a name of `terminal`; raises ConfigError where that cannot be, and replaces nothing but a name."""
    _require_free(link)
    try:
        with contextlib.suppress(FileExistsError):
            link.symlink_to(terminal)
            return
        _require_free(link)
        fresh = hidden_name(link)
        fresh.symlink_to(terminal)
        give_name(fresh, link, replace=True)
    except OSError as error:
        raise ConfigError(
            f"{link} cannot be made the terminal's name ({error.strerror}); choose a --link in a folder that is yours"
        ) from None


class TcpPort:
    """A listening TCP port at one of the `addresses` of a host."""

    def __init__(self, address: Address) -> None:
        try:
            self._socket = socket.create_server(address.to[:2], family=address.family)
        except OSError as error:
            raise HardwareError(f"cannot listen on {address} ({error.strerror}); choose another port") from None
        self._socket.setblocking(False)

    @property
    def is_network(self) -> bool:
        """Even on loopback, a web page in a browser on this machine can connect."""
        return True

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
            connection, peer = self._socket.accept()
        except OSError:  # nobody there, gone again, or out of file numbers: whoever waits is taken in a moment
            return None
        try:
            return TcpChannel(connection, f"{peer[0]}:{peer[1]}")
        except OSError:  # it is gone already
            connection.close()
            return None

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()


class TcpChannel:
    """One TCP connection."""

    def __init__(self, connection: socket.socket, peer: str) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._socket = connection
        self._peer = peer

    @property
    def peer(self) -> str:
        """Host and port."""
        return self._peer

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
