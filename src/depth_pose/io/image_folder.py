"""A folder of depth images, PNG or NPY, as a recording, with `ImageOptions` for the missing data.

Options that are not given are read from ``camera.json`` in the folder, if it exists: ``fx``, ``fy``, ``cx``,
``cy``, ``depth_scale``, ``fps``.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import re
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.image_size import check_size
from depth_pose.io import schemas
from depth_pose.io._topics import RawMessage, Topic, counted
from depth_pose.io.compressed import decode_png
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.messages import write_camera_info, write_image

CAMERA_FILE = "camera.json"
IMAGE_ENDINGS = (".png", ".npy")

FRAME_ID = "camera_depth_optical_frame"
"""Frame id of the images; files have none."""

INFO_TOPIC = schemas.DEPTH_TOPIC.rpartition("/")[0] + "/camera_info"
"""Topic of the camera, beside the images."""

_FPS = 30.0
"""Default frame rate (Hz), that of most sensors."""

_START_NS = 1_000_000_000
"""Stamp of the first image (ns); 0 means no time in ROS."""

_NO_TIMES = f"the names of the images are no times: {_FPS:g} a second are assumed; --fps sets another rate"

_MOST_S = (1 << 31) - 1
"""Maximum seconds in a message's stamp."""

_DATE = re.compile(
    r"\D*(\d{4})[-_.]?(\d\d)[-_.]?(\d\d)[-_ T.]+"
    r"(\d\d)[-_.:h]?(\d\d)[-_.:m]?(\d\d)(?:[-_.,](\d{1,9}))?\D*"
)
"""Names with a date and a time of day (UTC): ``2024-05-01_12-30-15.250``, ``20240501T123015``."""

_NPY_MAGIC = b"\x93NUMPY"
_NPY_ERRORS: tuple[type[Exception], ...] = (ValueError, EOFError, SyntaxError, TypeError, OverflowError)
_NPY_ERRORS += (RecursionError, MemoryError, tokenize.TokenError)
"""Exceptions of NumPy for files that are not arrays."""

_MOST_BYTES = 128 << 20
"""Maximum size of an image file (bytes)."""


def image_files(folder: Path) -> list[Path]:
    """Return the depth images of a folder, or of ``depth`` in it, in order; empty if there are none."""
    for inside in (folder, folder / "depth"):
        if inside.is_dir():
            files = [p for p in inside.iterdir() if p.suffix.lower() in IMAGE_ENDINGS and p.is_file()]
            named = [p for p in files if "depth" in p.stem.lower()]
            if files:
                return sorted(named or files, key=_natural)
    return []


def _natural(path: Path) -> tuple[list[int], str]:
    time_ns = _time_ns(path.stem)
    numbers = [time_ns] if time_ns is not None else [int(n) for n in re.findall(r"\d+", path.stem)]
    return numbers, path.name


def _time_ns(name: str) -> int | None:
    """Parse a name that is a time to nanoseconds; None for other names.

    Times are seconds with a fraction; milliseconds, microseconds or nanoseconds since 1970 (13, 16 or 19
    digits); and dates with a time of day. Text without digits may stand around them.
    """
    if found := re.fullmatch(r"\D*?(\d{1,10})\.(\d{1,9})\D*", name):
        return _to_ns(int(found[1]), found[2])
    if found := re.fullmatch(r"\D*(\d{10})(\d{3}|\d{6}|\d{9})\D*", name):
        return _to_ns(int(found[1]), found[2])
    if found := _DATE.fullmatch(name):
        year, month, day, hour, minute, second = (int(part) for part in found.groups()[:6])
        with contextlib.suppress(ValueError):
            moment = datetime(year, month, day, hour, minute, second, tzinfo=timezone.utc)
            return _to_ns(int(moment.timestamp()), found[7] or "0")
    return None


def _to_ns(seconds: int, fraction: str) -> int | None:
    return seconds * 1_000_000_000 + int(fraction.ljust(9, "0")) if 0 <= seconds <= _MOST_S else None


class ImageFolder:
    """A folder of depth images.

    Parameters
    ----------
    folder : Path
    options : ImageOptions

    Attributes
    ----------
    topics : list of Topic
        Topics of the images and of their camera.
    others : dict
        Empty.
    notes : list of str
        What is assumed.

    Raises
    ------
    InputError
        If the camera is unknown, or the first image cannot be read.
    """

    def __init__(self, folder: Path, options: ImageOptions) -> None:
        self.others: dict[str, str] = {}
        self._files = image_files(folder)
        self._folder = folder
        given = _completed(options, folder)
        if given.fx is None or given.fy is None or given.cx is None or given.cy is None:
            raise InputError(
                f"{folder} is a folder of images, which have no camera parameters: "
                f"write {folder / CAMERA_FILE} (fx, fy, cx, cy in pixels), or give run, info or play "
                "--intrinsics FX,FY,CX,CY"
            )
        self._scale = given.depth_scale
        self._stamps = _stamps(self._files, given.fps)
        self.notes = [] if given.fps or self._stamps[0] != _START_NS else [_NO_TIMES]
        height, width = self._first_size()
        self._camera = Camera(width, height, given.fx, given.fy, given.cx, given.cy)
        self._bad: dict[str, str] = {}
        count = len(self._files)
        self.topics = [
            Topic(schemas.DEPTH_TOPIC, schemas.IMAGE, count, schemas.schema_text(schemas.IMAGE)),
            Topic(INFO_TOPIC, schemas.CAMERA_INFO, count, schemas.schema_text(schemas.CAMERA_INFO)),
        ]

    def _first_size(self) -> tuple[int, int]:
        """Return the size of the first readable image."""
        for file in self._files[:-1]:
            with contextlib.suppress(InputError):
                height, width = _read(file, self._scale).shape
                return height, width
        height, width = _read(self._files[-1], self._scale).shape
        return height, width

    def messages(self, topics: Iterable[str]) -> Iterator[RawMessage]:
        """Yield the images and their camera as messages, in order."""
        wanted = set(topics)
        for file, stamp_ns in zip(self._files, self._stamps, strict=True):
            if INFO_TOPIC in wanted:
                info = write_camera_info(stamp_ns, FRAME_ID, self._camera)
                yield RawMessage(INFO_TOPIC, stamp_ns, info)
            if schemas.DEPTH_TOPIC in wanted:
                try:
                    pixels = _read(file, self._scale)
                except InputError as error:
                    self._bad[file.name] = str(error)
                    continue
                yield RawMessage(schemas.DEPTH_TOPIC, stamp_ns, write_image(stamp_ns, FRAME_ID, pixels))

    @property
    def damage(self) -> list[str]:
        """Return the damage found so far: one line, or none."""
        if not self._bad:
            return []
        first = next(iter(self._bad.values()))
        return [
            f"{self._folder} has {counted(len(self._bad), 'damaged image')}, left out (the first: {first})"
        ]


def _completed(options: ImageOptions, folder: Path) -> ImageOptions:
    """Add the options of the folder's own file."""
    path = folder / CAMERA_FILE
    if not path.is_file():
        return options
    names = [field.name for field in fields(ImageOptions)]
    try:
        if path.stat().st_size > 1 << 16:
            raise ValueError("it is too large")
        found = json.loads(path.read_text("utf-8-sig"))
        said = {name: float(found[name]) for name in names if name in found}
    except (OSError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError(f"{path} cannot be read: {error}") from error
    if not all(map(math.isfinite, said.values())):
        raise InputError(f"{path}: all numbers must be finite")
    try:
        return replace(options, **{n: v for n, v in said.items() if getattr(options, n) is None})
    except ConfigError as error:
        raise InputError(f"{path}: {error}") from error


def _stamps(files: list[Path], fps: float | None) -> list[int]:
    """Return the images' times, nanoseconds."""
    if fps is None:
        times = [_time_ns(file.stem) for file in files]
        known = [time for time in times if time is not None]
        if len(known) == len(files) and known == sorted(set(known)):
            return known
    return [_START_NS + round(i * 1e9 / (fps or _FPS)) for i in range(len(files))]


def _read(file: Path, scale: float | None) -> NDArray[np.generic]:
    """Read an image: uint16 millimetres, or float32 metres."""
    try:
        if file.stat().st_size > _MOST_BYTES:
            raise InputError(f"{file} is too large")
        pixels = decode_png(file.read_bytes()) if file.suffix.lower() == ".png" else _read_npy(file)
    except OSError as error:
        if error.errno == errno.ENOMEM:  # the file is not at fault
            raise MemoryError(f"{file} cannot be mapped") from error
        raise InputError(f"{file} cannot be read: {error.strerror or error}") from error
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    if scale is None:
        scale = 1.0 if pixels.dtype.kind == "f" else 0.001
    if pixels.dtype == np.uint16 and scale == 0.001:
        return pixels
    with np.errstate(over="ignore", invalid="ignore"):
        return (pixels.astype(np.float64) * scale).astype(np.float32)


def _read_npy(file: Path) -> NDArray[np.generic]:
    with file.open("rb") as stream:
        if stream.read(len(_NPY_MAGIC)) != _NPY_MAGIC:  # NumPy would also accept an archive
            raise InputError("not an NPY array")
    try:  # memory-mapped, so that allocation is limited by the file's size
        pixels = np.load(file, mmap_mode="r", allow_pickle=False)
    except _NPY_ERRORS as error:
        raise InputError(f"not an NPY array: {' '.join(str(error).split())[:200]}") from error
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[..., 0]
    if pixels.ndim != 2 or pixels.dtype.kind not in "uif":
        raise InputError(f"the array is {pixels.dtype}{list(pixels.shape)}; depth has one number per pixel")
    check_size("image", *pixels.shape)
    return np.array(pixels, pixels.dtype.newbyteorder("="))
