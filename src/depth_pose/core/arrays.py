"""Read NumPy's ``.npz`` files: declared sizes are checked before anything is allocated.

A member's header declares its shape, and a damaged or hostile one may declare anything: 5 MB of compressed
zeros unpack to gigabytes. The headers of all members are read first, and their sum is limited.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from depth_pose.core.errors import InputError
from depth_pose.core.reading import open_ordinary

MOST_MEMBERS = 1000
"""Maximum number of arrays in a file; a bank has 11, a volume model 20."""

FREE_BYTES = 1 << 28
"""Size (bytes) up to which arrays are read whatever the size of their file: 256 MiB."""

MOST_RATIO = 40
"""Maximum ratio of larger arrays to their file's size: 6 for the embedded body, 2.3 for simulated truths,
1,000 for zeros."""


class DamagedArrays(ValueError):
    """A file is not an ``.npz`` file of plain arrays; the message says why."""


def load_arrays(path: Path | str, names: Collection[str] | None = None) -> dict[str, NDArray[Any]]:
    """Read the arrays of an ``.npz`` file; never pickled objects.

    Parameters
    ----------
    path : path
    names : collection of str, optional
        Only these, where they exist; all by default.

    Raises
    ------
    DamagedArrays
        Where the file is missing, damaged, or declares more than it may hold.
    """
    try:
        with open_ordinary(path) as stream, zipfile.ZipFile(stream) as archive:
            members = _members(archive, names)
            size = sum(_declared(archive, member) for member in members.values())
            most = max(FREE_BYTES, MOST_RATIO * stream.seek(0, 2))
            if size > most:
                raise DamagedArrays(
                    f"its arrays are declared as {size / 1e6:.0f} MB; at most {most / 1e6:.0f} MB fit it"
                )
            return {name: _read(archive, member) for name, member in members.items()}
    except DamagedArrays:
        raise
    except InputError as error:
        raise DamagedArrays(str(error).removeprefix(f"{path} cannot be read: ")) from error
    except Exception as error:  # damaged archives and headers raise a dozen kinds
        raise DamagedArrays(" ".join(f"{error}".split()) or type(error).__name__) from error


def array_names(path: Path | str) -> frozenset[str]:
    """List the names of the arrays of an ``.npz`` file; empty if it cannot be read."""
    try:
        with open_ordinary(path) as stream, zipfile.ZipFile(stream) as archive:
            return frozenset(_members(archive, None))
    except Exception:  # as above
        return frozenset()


def _members(archive: zipfile.ZipFile, names: Collection[str] | None) -> dict[str, zipfile.ZipInfo]:
    found: dict[str, zipfile.ZipInfo] = {}
    if len(archive.filelist) > MOST_MEMBERS:
        raise DamagedArrays(f"it has {len(archive.filelist)} members; at most {MOST_MEMBERS} are read")
    for member in archive.filelist:
        name = member.filename.removesuffix(".npy")
        if name in found:
            raise DamagedArrays(f"it has two members {name}")
        if names is None or name in names:
            found[name] = member
    return found


def _header(stream: Any) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Read an array's header; return shape, type and bytes of the content."""
    version = npy.read_magic(stream)
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    shape, _, dtype = read(stream)
    if dtype.hasobject or dtype.names is not None or dtype.subdtype is not None:
        raise DamagedArrays(f"it holds {dtype}, which are not plain numbers")
    if min(shape, default=0) < 0:
        raise DamagedArrays(f"it has an array of shape {shape}")
    return shape, dtype, math.prod(shape) * max(dtype.itemsize, 1)


def _declared(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> int:
    with archive.open(member) as stream:
        _, _, size = _header(stream)
    if size > member.file_size:
        raise DamagedArrays(
            f"{member.filename} is cut short: {size} bytes are declared, {member.file_size} there"
        )
    return member.file_size


def _read(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(member) as stream:
        array: NDArray[Any] = npy.read_array(stream, allow_pickle=False)
        if stream.read(1):  # to the end, where the checksum is verified
            raise DamagedArrays(f"{member.filename} is longer than its array")
    return array
