"""Benches at the end of a line: the protocol, the client, and an emulated firmware that serves any bench.

`docs/serial-protocol.md` specifies what goes over the line.
"""

from campaigns.serial.client import SerialBench
from campaigns.serial.emulator import EmulatedBench, EmulatorProcess
from campaigns.serial.serve import ServeOptions
from campaigns.serial.transport import SerialTransport, TcpTransport, transport_at

__all__ = [
    "EmulatedBench",
    "EmulatorProcess",
    "SerialBench",
    "SerialTransport",
    "ServeOptions",
    "TcpTransport",
    "transport_at",
]
