"""A reader of OSC, after the OSC 1.0 specification: independent of what sends it."""

from __future__ import annotations

import struct
from collections.abc import Iterator


def read_osc(data: bytes) -> Iterator[tuple[str, list[float | str]]]:
    """(address, arguments) of a message or of all in a bundle."""
    if data.startswith(b"#bundle\0"):
        at = 16
        while at < len(data):
            (size,) = struct.unpack_from(">i", data, at)
            yield from read_osc(data[at + 4 : at + 4 + size])
            at += 4 + size
        return
    address, at = _text(data, 0)
    kinds, at = _text(data, at)
    values: list[float | str] = []
    for kind in kinds[1:]:
        if kind == "f":
            values.append(struct.unpack_from(">f", data, at)[0])
            at += 4
        else:
            assert kind == "s"
            text, at = _text(data, at)
            values.append(text)
    yield address, values


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(b"\0", at)
    return data[at:end].decode(), (end // 4 + 1) * 4
