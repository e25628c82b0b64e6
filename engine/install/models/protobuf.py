"""The wire format of Protocol Buffers, in which ONNX files are written."""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO, NamedTuple

_VARINT, _EIGHT_BYTES, _BYTES, _FOUR_BYTES = 0, 1, 2, 5
"""Kinds of fields; bytes come after their length."""


class NotProtobuf(ValueError):
    """The bytes are no message, or a message that `is_cut`; says at which byte."""

    def __init__(self, place: str, *, is_cut: bool) -> None:
        super().__init__(place)
        self.is_cut = is_cut


class Field(NamedTuple):
    """A field of a message: an integer, or the bytes of any other value by their place and length in the file.

    `integer` is None for the latter.
    """

    number: int
    integer: int | None
    start: int
    length: int


def fields(content: IO[bytes], start: int, end: int) -> Iterator[Field]:
    """Yield the fields of the message between two places of a file; the caller may read elsewhere in between.

    Raises
    ------
    NotProtobuf
        When the message has another form, or ends before its last field does.
    """
    place = start
    while place < end:
        content.seek(place)
        tag = varint(content)
        number, kind = tag >> 3, tag & 7
        integer, length = None, 0
        if kind == _VARINT:
            integer = varint(content)
        elif kind == _BYTES:
            length = varint(content)
        elif kind in (_EIGHT_BYTES, _FOUR_BYTES):
            length = 8 if kind == _EIGHT_BYTES else 4
        else:
            raise NotProtobuf(f"byte {place:,}", is_cut=False)
        begin = content.tell()
        if number == 0 or begin + length > end:
            raise NotProtobuf(f"byte {place:,} of {end:,}", is_cut=True)
        yield Field(number, integer, begin, length)
        place = begin + length


def varint(content: IO[bytes]) -> int:
    """Return the next integer of a file, seven bits per byte, the lowest first.

    Raises
    ------
    NotProtobuf
        When the file ends within it, or it has more than ten bytes.
    """
    value = 0
    for shift in range(0, 70, 7):
        byte = content.read(1)
        if not byte:
            raise NotProtobuf(f"byte {content.tell():,}", is_cut=True)
        value |= (byte[0] & 0x7F) << shift
        if byte[0] < 0x80:
            return value
    raise NotProtobuf(f"byte {content.tell():,}", is_cut=False)
