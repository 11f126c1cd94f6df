"""What the firmware answers with, and the checks of what it was sent, apart from its state."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from campaigns.serial.commands import Code, Failure
from campaigns.serial.description import Description
from campaigns.serial.frames import BLOCK_BYTES, Block, blocks_in, encode_block
from campaigns.serial.program import decode_segment, record_channels
from sim_backend.bench import Segment, check_segment
from sim_backend.errors import ConfigError

MAX_BURST_BLOCKS = 4096


class Refused(Exception):  # noqa: N818 - it is an answer, not a failure of this program
    """A command that is not carried out; becomes the reply `ERR code,"message"`."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.failure = Failure(code, message)


@dataclass(frozen=True)
class Reply:
    """A line to send, and blocks after it."""

    text: str
    blocks: Iterator[bytes] = iter(())


@dataclass(frozen=True)
class Upload:
    """Blocks that the host announced: `count` from `first` on, of a transfer of `total_bytes`."""

    run: int
    first: int
    count: int
    total_bytes: int


@dataclass
class Incoming:
    """A segment being uploaded: what was announced of it, and what has come."""

    run: int
    total_bytes: int
    crc: int
    data: bytearray

    @property
    def next(self) -> int:
        """The first block that is missing."""
        return blocks_in(len(self.data))


def vetted(image: bytes, about: Description) -> Segment:
    """Return the segment of an image once it keeps the limits of `about`; raises Refused."""
    try:
        segment = decode_segment(image, about.channel_names)
        check_segment(segment, about.limits)
    except ConfigError as error:
        raise Refused(Code.RANGE, str(error)) from None
    rates = {f.rate_hz for f in segment.feedback if f} | {x.filter.rate_hz for x in segment.learning if x}
    if rates - {about.rate_hz}:
        raise Refused(Code.RANGE, f"controllers for {sorted(rates)} Hz; this bench runs at {about.rate_hz:g} Hz")
    if max(len(segment.feedback), len(segment.learning)) > len(about.axes):
        raise Refused(Code.RANGE, f"loops for more axes than the {len(about.axes)} there are")
    columns = len(record_channels(segment, about.channel_names, about.default_names))
    if 8 * columns * segment.n_samples > about.memory_bytes:
        raise Refused(
            Code.TOO_MUCH,
            f"a record of {segment.n_samples} samples of {columns} channels; the memory is {about.memory_bytes} bytes",
        )
    return segment


def burst(image: bytes, run: int, first: int, count: int) -> Reply:
    """Return the answer that sends `count` blocks of an image from `first` on; raises Refused for none there are."""
    total = blocks_in(len(image))
    if not (0 <= first < total and 0 < count <= MAX_BURST_BLOCKS):
        raise Refused(Code.RANGE, f"{count} blocks from {first}; there are {total}")
    last = min(first + count, total)
    cut = (Block(run, i, image[i * BLOCK_BYTES : (i + 1) * BLOCK_BYTES]) for i in range(first, last))
    return Reply(f"{first},{last - first}", map(encode_block, cut))


def integers(parameters: tuple[str, ...], count: int) -> list[int]:
    """Return so many whole numbers; raises Refused for anything else."""
    if len(parameters) != count or not all(p.isdecimal() and len(p) <= 12 for p in parameters):
        raise Refused(Code.PARAMETER, f"{count} whole numbers wanted, got: {','.join(parameters)[:60]}")
    return [int(p) for p in parameters]


def number(parameters: tuple[str, ...], low: float, high: float) -> float:
    """Return one number from `low` to `high`; raises Refused for anything else."""
    try:
        value = float(parameters[0]) if len(parameters) == 1 else float("nan")
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise Refused(Code.RANGE, f"{','.join(parameters)[:40]}: a number from {low:g} to {high:g} is wanted")
    return value
