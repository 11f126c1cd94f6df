"""The host's end of the line: a serial port or a TCP connection, opened and read alike."""

from __future__ import annotations

import contextlib
import select
import socket
import termios
import time
from typing import Protocol

import serial

from campaigns.serial.addresses import Address, resolved
from campaigns.serial.frames import LineNoise
from campaigns.serial.shared_token import shared_token
from sim_backend.errors import ConfigError

BITS_PER_BYTE = 10
USUAL_BAUD = "115200"
"""Baud rate of a serial bench whose address has none."""
MOST_BAUD = 100_000_000
_PIECE_BYTES = 65536


class LinkLost(LineNoise):
    """The line to the bench is gone; it may come back."""


class Transport(Protocol):
    """A line that can be opened again after it was lost."""

    @property
    def name(self) -> str:
        """What to call it in errors."""

    @property
    def bytes_per_s(self) -> float:
        """How fast bytes pass; a guess on the safe side where the line does not say."""

    @property
    def token(self) -> bytes | None:
        """What to show to a bench that asks for its token."""

    def open(self, timeout_s: float) -> None:
        """Open it, or open it again; raises LinkLost."""

    def read(self, timeout_s: float) -> bytes:
        """Return what has come in, waiting up to `timeout_s` for the first byte; raises LinkLost."""

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all of `data` within `timeout_s`; raises LinkLost."""

    def close(self) -> None:
        """Let it go; never raises."""


class SerialTransport:
    """A serial device through pyserial, for this process alone; a USB adapter may ignore the rate."""

    def __init__(self, device: str, baud: int = 115200) -> None:
        self._device = device
        self._baud = baud
        self._port: serial.Serial | None = None

    @property
    def name(self) -> str:
        """The device."""
        return self._device

    @property
    def bytes_per_s(self) -> float:
        """Ten bits per byte."""
        return self._baud / BITS_PER_BYTE

    @property
    def token(self) -> bytes | None:
        """None: whoever may open the device may use it."""
        return None

    def open(self, timeout_s: float) -> None:
        """Open the device exclusively and drop what it had received for somebody else."""
        self.close()
        try:
            self._port = serial.Serial(
                self._device, self._baud, timeout=0, write_timeout=timeout_s, exclusive=True, rtscts=False
            )
            self._port.reset_input_buffer()
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            self.close()
            raise LinkLost(
                f"{self._device} cannot be opened ({_reason(error)}); check cable, name and rights"
            ) from None

    def read(self, timeout_s: float) -> bytes:
        """Wait for bytes and return all there are."""
        port = self._opened()
        try:
            if not select.select([port.fileno()], [], [], timeout_s)[0]:
                return b""
            data: bytes = port.read(_PIECE_BYTES)
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            raise LinkLost(f"{self._device} was lost ({_reason(error)}); check the cable") from None
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all of it."""
        port = self._opened()
        try:
            port.write_timeout = timeout_s
            port.write(data)
        except (serial.SerialException, OSError, ValueError, termios.error) as error:
            raise LinkLost(f"{self._device} takes no data ({_reason(error)}); check cable and bench") from None

    def close(self) -> None:
        """Close the device without waiting for what was not sent."""
        if self._port is not None:
            with contextlib.suppress(serial.SerialException, OSError, ValueError, termios.error):
                self._port.reset_output_buffer()  # a bench that takes nothing would hold up the close
            with contextlib.suppress(serial.SerialException, OSError, ValueError):
                self._port.close()
            self._port = None

    def _opened(self) -> serial.Serial:
        if self._port is None:
            raise LinkLost(f"{self._device} is not open; connect first")
        return self._port


class TcpTransport:
    """A TCP connection; `bytes_per_s` bounds how long a transfer may take, `token` is for a bench that asks for one.

    The host name is looked up once, so that reconnecting leads to the same machine.
    """

    def __init__(self, host: str, port: int, bytes_per_s: float = 1e6, token: bytes | None = None) -> None:
        self._host, self._port = host, port
        self._bytes_per_s = bytes_per_s
        self._token = token
        self._addresses: list[Address] = []
        self._socket: socket.socket | None = None

    @property
    def name(self) -> str:
        """Host and port."""
        return f"{self._host}:{self._port}"

    @property
    def bytes_per_s(self) -> float:
        """Lowest rate that is expected of the network."""
        return self._bytes_per_s

    @property
    def token(self) -> bytes | None:
        """The token for the bench, None without one."""
        return self._token

    def another(self) -> TcpTransport:
        """Return a second connection to the same bench, not open yet."""
        return TcpTransport(self._host, self._port, self._bytes_per_s, self._token)

    def open(self, timeout_s: float) -> None:
        """Connect, to the first address of the host that answers; raises ConfigError when it has none."""
        self.close()
        self._addresses = self._addresses or resolved(self._host, self._port)
        end_s, reason = time.monotonic() + timeout_s, ""
        for address in self._addresses:
            try:
                self._socket = socket.socket(address.family, socket.SOCK_STREAM)
                self._socket.settimeout(max(end_s - time.monotonic(), 0.05))
                self._socket.connect(address.to)
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                return
            except OSError as error:
                reason = reason or _reason(error)
                self.close()
        raise LinkLost(f"{self.name} cannot be reached ({reason}); check address and bench")

    def read(self, timeout_s: float) -> bytes:
        """Wait for bytes and return all there are."""
        connection = self._opened()
        try:
            if not select.select([connection], [], [], timeout_s)[0]:
                return b""
            data = connection.recv(_PIECE_BYTES)
        except (OSError, ValueError) as error:
            raise LinkLost(f"{self.name} was lost ({_reason(error)}); check the network") from None
        if not data:
            raise LinkLost(f"{self.name} has hung up; check the bench")
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all of it."""
        connection = self._opened()
        try:
            connection.settimeout(timeout_s)
            connection.sendall(data)
        except (OSError, ValueError) as error:
            raise LinkLost(f"{self.name} takes no data ({_reason(error)}); check network and bench") from None

    def close(self) -> None:
        """Hang up."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise LinkLost(f"{self.name} is not connected; connect first")
        return self._socket


def transport_at(kind: str, address: str) -> Transport:
    """Return the transport of `serial` DEVICE[@BAUD] or `tcp` HOST:PORT; raises ConfigError for another format."""
    if kind == "serial":
        device, _, baud = address.rpartition("@") if "@" in address else (address, "", USUAL_BAUD)
        if not device:
            raise ConfigError(f"serial:{address} names no device; write serial:DEVICE or serial:DEVICE@BAUD")
        if not baud.isdecimal() or not 0 < int(baud) <= MOST_BAUD:
            raise ConfigError(
                f"serial:{address} has the baud rate '{baud}'; it must be a whole number from 1 to {MOST_BAUD}, as in "
                f"serial:{device}@{USUAL_BAUD}"
            )
        return SerialTransport(device, int(baud))
    host, _, port = address.rpartition(":")
    if not host:
        raise ConfigError(f"tcp:{address} names no host; write tcp:HOST:PORT")
    if not port.isdecimal() or not 0 < int(port) < 65536:
        raise ConfigError(f"tcp:{address} has the port '{port}'; it must be a whole number from 1 to 65535")
    return TcpTransport(host, int(port), token=shared_token())


def _reason(error: Exception) -> str:
    return " ".join((getattr(error, "strerror", None) or str(error) or type(error).__name__).split())
