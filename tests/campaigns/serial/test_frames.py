"""Lines and blocks: what goes in comes out, and nothing else does."""

from __future__ import annotations

import binascii
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.serial.frames import (
    BLOCK_BYTES,
    MAX_LINE_BYTES,
    Block,
    Line,
    LineNoise,
    Receiver,
    block_length,
    blocks_in,
    data_bytes_of,
    decode_block,
    encode_block,
    encode_line,
    parse_line,
    split,
)

texts = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1, max_size=200).map(str.strip)
tags = st.integers(0, 0xFFFF)
blocks = st.builds(Block, st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.binary(max_size=BLOCK_BYTES))


def test_a_line_as_the_document_writes_it() -> None:
    """Against another implementation of the checksum, so that firmware written from the document agrees."""
    body = b"STAT? @00A7"
    assert encode_line("STAT?", 0xA7) == b"\n" + body + b"*%08X\n" % binascii.crc32(body)


def test_a_block_as_the_document_writes_it() -> None:
    data = b"\n#0*"
    head = struct.pack("<II", 17, 3)
    expected = b"#216" + head + struct.pack("<I", binascii.crc32(head + data)) + data + b"\n"
    assert encode_block(Block(17, 3, data)) == expected


@given(texts.filter(bool), tags)
def test_a_line_comes_back(text: str, tag: int) -> None:
    assert parse_line(encode_line(text, tag).strip(b"\n")) == Line(text, tag)


@given(texts.filter(bool), tags, st.data())
def test_a_flipped_bit_never_gives_another_checked_line(text: str, tag: int, data: st.DataObject) -> None:
    """CRC-32 sees every single flipped bit; at worst the line looks unchecked, which carries out nothing."""
    raw = bytearray(encode_line(text, tag).strip(b"\n"))
    i = data.draw(st.integers(0, len(raw) - 1))
    raw[i] ^= 1 << data.draw(st.integers(0, 7))
    line = parse_line(bytes(raw))
    assert line is None or line.tag is None


@given(st.binary(max_size=3000))
def test_no_bytes_break_the_receiver(noise: bytes) -> None:
    receiver = Receiver()
    receiver.feed(noise)
    while receiver.line() is not None:
        pass
    assert len(receiver) <= MAX_LINE_BYTES


@given(st.binary(max_size=600), texts.filter(bool), tags)
def test_a_line_after_noise_is_found(noise: bytes, text: str, tag: int) -> None:
    receiver = Receiver()
    receiver.feed(noise + encode_line(text, tag))
    found = []
    while (line := receiver.line()) is not None:
        found.append(line)
    assert found[-1] == Line(text, tag)


def test_text_that_is_no_ascii_or_too_long_still_makes_a_checked_line() -> None:
    line = parse_line(encode_line("θ\n" * 500, 1).strip(b"\n"))
    assert line is not None and line.tag == 1 and line.text.startswith("\\u03b8")


@given(blocks)
def test_a_block_comes_back(block: Block) -> None:
    raw = encode_block(block)
    assert len(raw) == block_length(len(block.data))
    assert decode_block(raw, len(block.data)) == block


@given(blocks, st.data())
def test_a_flipped_bit_in_a_block_is_noticed(block: Block, data: st.DataObject) -> None:
    raw = bytearray(encode_block(block))
    i = data.draw(st.integers(0, len(raw) - 1))
    raw[i] ^= 1 << data.draw(st.integers(0, 7))
    with pytest.raises(LineNoise):
        decode_block(bytes(raw), len(block.data))


@given(st.binary(max_size=4 * BLOCK_BYTES), st.lists(st.integers(1, 700), max_size=8))
def test_a_transfer_comes_back_however_its_bytes_are_cut(image: bytes, cuts: list[int]) -> None:
    stream = b"".join(map(encode_block, split(image, 5)))
    receiver, got, sizes = Receiver(), bytearray(), [*cuts, len(stream)]
    for size in sizes:
        receiver.feed(stream[:size])
        stream = stream[size:]
        while len(got) < len(image):
            block = receiver.block(data_bytes_of(len(got) // BLOCK_BYTES, len(image)))
            if block is None:
                break
            got += block.data
    assert bytes(got) == image
    assert blocks_in(len(image)) == len(split(image, 5))
