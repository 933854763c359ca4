"""Arrays as one block of bytes: nothing is lost, and what is no such block is refused."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.core.errors import InputError
from depth_pose.core.packing import pack, unpack

RECORD = np.dtype([("name", "S5"), ("at", "<f8", 3), ("is_here", "?")])


def arrays():
    records = np.zeros(3, RECORD)
    records["name"], records["at"] = b"abc", np.arange(9).reshape(3, 3)
    return [records, np.arange(5, dtype="<f4").reshape(5, 1), np.zeros(0), np.arange(3, dtype="u1")]


def test_round_trip():
    given = arrays()
    back = unpack(pack(given), [a.dtype for a in given])
    for a, b in zip(back, given, strict=True):
        assert a.tobytes() == b.tobytes() and a.dtype == b.dtype and a.flags.writeable


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (lambda d: b"", "0 bytes"),
        (lambda d: d[:-1], "an array ends at|the data has"),
        (lambda d: d[:30], "no block of 4 arrays"),
        (lambda d: d[:8] + np.uint64(2**63).tobytes() + d[16:], "and its arrays"),
        (lambda d: d[:8] + np.uint64(5).tobytes() + d[16:], "and its arrays"),
        (lambda d: b"x" + d[1:], "another version"),
    ],
)
def test_other_data_is_refused(data, says):
    given = arrays()
    whole = pack(given)
    whole = whole[: len(whole) - (-given[-1].nbytes % 8)]
    with pytest.raises(InputError, match=says):
        unpack(data(whole), [a.dtype for a in given])


def test_other_types_are_refused():
    with pytest.raises(InputError, match="another version"):
        unpack(pack([np.zeros(3)]), ["<f4"])
