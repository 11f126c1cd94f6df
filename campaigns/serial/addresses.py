"""Names of hosts and what they stand for; what can be no host is a mistake of the user and reported as such."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass
from typing import Any

from sim_backend.errors import ConfigError


@dataclass(frozen=True)
class Address:
    """Where a host can be reached: family and socket address, under the name that the user gave."""

    host: str
    family: socket.AddressFamily
    to: tuple[Any, ...]

    def __str__(self) -> str:
        return f"{self.host}:{self.to[1]}"


def resolved(host: str, port: int) -> list[Address]:
    """Return the addresses of a host, a name or a number with or without brackets.

    Raises ConfigError for a name that cannot be one or that nobody knows.
    """
    name = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    try:
        if not name:
            raise ValueError("it is empty")
        found = socket.getaddrinfo(name, port, type=socket.SOCK_STREAM)
    except (OSError, ValueError) as error:  # UnicodeError, of labels that are empty or too long, is a ValueError
        reason = " ".join((getattr(error, "strerror", None) or str(error)).split())
        raise ConfigError(f"host '{host}': no address can be found ({reason}); correct the name") from None
    return [Address(host, socket.AddressFamily(family), to) for family, _, _, _, to in found]


def is_loopback(address: Address) -> bool:
    """Return whether an address is local to this machine."""
    return ipaddress.ip_address(str(address.to[0]).partition("%")[0]).is_loopback
