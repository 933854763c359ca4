"""The library's front door: depth images or point clouds in, skeletons out.

`Tracker` checks its inputs, so that a wrong unit or camera is an error and not a frame without people.
"""

from __future__ import annotations

import math
import threading
import warnings
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from depth_pose.bank.bank import Bank, default_bank_path
from depth_pose.core.camera import Camera, Lens
from depth_pose.core.config import PipelineConfig
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.frame import DepthFrame
from depth_pose.core.progress import loading
from depth_pose.core.settings_file import read_settings
from depth_pose.core.stamps import is_late
from depth_pose.io.calibration import camera_from_info
from depth_pose.io.clouds import BODY_AXES, frame_from_cloud
from depth_pose.io.depth_unit import INTEGER_UNIT_M, in_metres, is_indoors, median_depth
from depth_pose.io.rectification import rectify_depth
from depth_pose.people import People
from depth_pose.pipeline import PosePipeline
from depth_pose.track.label_image import LabelImage

_LEAST_STEP_NS = 100_000
"""Integer times closer than this (10 kHz) are frame numbers or other units, not nanoseconds."""


_MOST_S = 9e9
"""Latest time (s): what 64 bits of nanoseconds hold."""

_MOST_CENTIMETRES = 800.0
"""Largest median of depths that may be centimetres."""

_LEAST_SECONDS = 0.005
"""Maximum step (s) of a floating-point time."""

_CAMERA_CALL = "depth_pose.Camera.from_matrix(K, width=640, height=480)"


class Tracker:
    """Track all people in a sequence of depth images.

    The first tracker on a machine compiles the kernels, which takes about a minute; later ones load them in
    seconds.

    Parameters
    ----------
    bank : Bank or path, optional
        Exemplar bank; by default the one that comes with the package, or that ``$DEPTH_POSE_BANK`` names.
    config : PipelineConfig, mapping or path, optional
        Settings by step, for instance ``{"segment": {"far": 4.0, "most_people": 2}}``; or a file of them,
        YAML or JSON, as ``depth-pose settings`` prints it.
    depth_scale : float, optional
        Metres per unit of the depth. By default integers are millimetres and floats are metres, and an
        image with implausible values is rejected; with a scale given every value is accepted.
    frame_id : str
        Name of the optical frame, for ``Skeleton.frame_id``.
    threads : int
        1 or 2: number of threads in which several people are measured and fitted. The result is the same.
    quiet : bool
        Show no progress.

    Raises
    ------
    BankError
        Where the bank is missing or damaged.
    ConfigError
        Where a setting is unknown or out of its range.

    Examples
    --------
    >>> from depth_pose.detect.sample_frame import sample_frame
    >>> frame = sample_frame()  # a person in front of a wall, 176 x 144, metres
    >>> tracker = Tracker(quiet=True)
    >>> people = tracker(frame.depth, frame.camera, time=0.0)
    >>> person = people["body_1"]
    >>> bool(abs(person["pelvis"].position[2] - 3.2) < 0.1)
    True
    >>> (same,) = tracker((1000 * frame.depth).astype("uint16"), frame.camera, time=0.04)
    >>> same.id
    'body_1'
    """

    def __init__(
        self,
        bank: Bank | Path | str | None = None,
        config: PipelineConfig | Mapping[str, Mapping[str, Any]] | Path | str | None = None,
        *,
        depth_scale: float | None = None,
        frame_id: str = "camera",
        threads: int = 1,
        quiet: bool = False,
    ) -> None:
        if depth_scale is not None and not (_is_number(depth_scale) and 0.0 < depth_scale < math.inf):
            raise ConfigError(f"depth_scale is {depth_scale!r}; it is metres per unit, above 0: 0.001")
        if not isinstance(frame_id, str):
            raise ConfigError(f"frame_id is {frame_id!r}; it is the name of the optical frame")
        if not (bank is None or isinstance(bank, (Bank, Path, str))):
            raise ConfigError(f"bank is {bank!r:.80}; give a Bank, or the path of one")
        if isinstance(config, (Path, str)):
            config = read_settings(Path(config))
        if not isinstance(config, PipelineConfig):
            config = PipelineConfig.from_mapping(config or {})
        self._depth_scale, self._frame_id, self._mount = depth_scale, frame_id, config.mount
        self._last_ns: int | None = None
        self._newest_ns: int | None = None
        self._is_unit_known = depth_scale is not None
        self._warned = frozenset[str]()
        self._notes: tuple[str, ...] = ()
        self._lock = threading.Lock()
        with ExitStack() as stack:
            if not quiet:
                stack.enter_context(loading("the bank"))
            self._pipeline = PosePipeline(
                bank if isinstance(bank, Bank) else Bank.load(bank or default_bank_path()),
                config,
                threads=threads,
            )
            self._pipeline.warm_up()

    def __call__(
        self, depth: ArrayLike | DepthFrame, camera: Camera | Lens | None = None, *, time: float | None = None
    ) -> People:
        """Find the skeletons of all people in the next frame.

        Parameters
        ----------
        depth : (H, W) array, (N, 3) or (H, W, 3) float array, or DepthFrame
            A depth image, distance along the optical axis: integer millimetres or float metres, 0 or NaN
            where nothing returned. Or a point cloud in the optical frame (x right, y down, z forward),
            metres. Or a frame of `depth_pose.read_recording`, which has its own camera and time.
        camera : Camera or Lens
            The camera of a depth image; a cloud has none. With a `Lens`, as `Camera.from_opencv` gives it,
            the distortion is removed.
        time : float or int, optional
            Seconds (float) or nanoseconds (int) of any clock. Frames that are late by at most 0.5 s are
            skipped with a warning. After more than 0.5 s poses are estimated anew; where time goes back, or
            ahead by more than 2 s, everybody is new. Without a time, the frame is processed by itself, and
            ids begin at ``body_1`` again.

        Returns
        -------
        People
            Everybody in view, a tuple of `Skeleton`; empty if there is nobody. With floor, labels and
            warnings of the frame.

        Raises
        ------
        InputError
            Where the frame cannot be used; the message says why.

        Warns
        -----
        RuntimeWarning
            Once where the images look upside down, were resized with interpolation, or are a sparse grid,
            where a cloud is in a body frame, and where nobody is found for a while (in a frame by itself: at
            once), with the most likely cause. Where a frame is late.
        """
        if not self._lock.acquire(blocking=False):
            raise InputError(
                "this tracker is working on a frame in another thread: it follows one camera; make a Tracker "
                "for each"
            )
        try:
            return self._track(depth, camera, time)
        finally:
            self._lock.release()

    def _track(
        self, depth: ArrayLike | DepthFrame, camera: Camera | Lens | None, time: float | None
    ) -> People:
        lens = camera if isinstance(camera, Lens) and camera.model else None
        if isinstance(depth, DepthFrame):
            if camera is not None or time is not None:
                raise InputError("a DepthFrame has its own camera and time: give it alone")
            frame = replace(depth, camera=_check_camera(depth.depth, depth.camera))
            self._check_unit(frame.depth, frame.depth.dtype, 1.0)
        else:
            values = np.ma.filled(depth, 0) if np.ma.isMaskedArray(depth) else np.asarray(depth)
            pinhole = camera.camera if isinstance(camera, Lens) else camera
            frame = self._make_frame(values, pinhole, self._stamp(time))
            if lens is not None:
                ideal = rectify_depth(frame.depth, lens)
                frame = replace(frame, depth=ideal.depth, camera=ideal.camera, filled=ideal.filled)
        if self._is_late(frame.stamp_ns):
            return People((), frame.stamp_ns, frame.frame_id, lens or frame.camera)
        result = self._pipeline.process_frame(frame)
        self._warn()
        return People(
            result.skeletons,
            frame.stamp_ns,
            frame.frame_id,
            lens or frame.camera,
            result.floor,
            self._doubts,
            LabelImage.of(result.people, frame, self._mount, lens),
        )

    def __reduce__(self) -> NoReturn:
        """Refuse to be pickled."""
        raise TypeError("a Tracker cannot be pickled or copied: make one in each process, for each camera")

    def reset(self) -> None:
        """Forget all earlier frames; people get new ids."""
        self._pipeline.reset()
        self._forget()

    def _forget(self) -> None:
        self._last_ns = self._newest_ns = None
        self._notes = ()

    def _is_late(self, stamp_ns: int) -> bool:
        """Check whether a frame is a little older than one before, and warn if it is."""
        if is_late(stamp_ns, self._newest_ns):
            assert self._newest_ns is not None, "a first frame is not late"
            late_s = (self._newest_ns - stamp_ns) * 1e-9
            line = f"a frame is skipped: it is {late_s:.3f} s older than one before it; sort frames by time"
            warnings.warn(line, RuntimeWarning, stacklevel=4)
            return True
        self._newest_ns = stamp_ns
        return False

    @property
    def _doubts(self) -> tuple[str, ...]:
        """Warnings about the frames since the last reset."""
        return (*self._notes, *self._pipeline.warnings)

    def _warn(self) -> None:
        """Issue each new warning about the frames once."""
        for line in self._doubts:
            if line not in self._warned:
                self._warned |= {line}
                warnings.warn(line, RuntimeWarning, stacklevel=4)

    def _stamp(self, time: float | None) -> int:
        """Convert a time to nanoseconds."""
        if time is None:
            self._pipeline.restart(single=True)
            self._forget()
            return 0
        if isinstance(time, (bool, np.bool_)) or not isinstance(time, (int, float, np.integer, np.floating)):
            raise InputError(f"time is {time!r}; give seconds as a float, or nanoseconds as an int")
        if not math.isfinite(time) or time < 0:
            raise InputError(f"time is {time}; it must be finite and not below 0")
        if time > _MOST_S * (1.0 if isinstance(time, (float, np.floating)) else 1e9):
            raise InputError(f"time is {time}; it is at most {_MOST_S:g} seconds, or as many nanoseconds")
        if isinstance(time, (float, np.floating)):
            if float(np.spacing(time)) > _LEAST_SECONDS:
                raise InputError(
                    f"time is the {type(time).__name__} {time}, which has steps of {np.spacing(time):.3g} s: "
                    "give float64, or integer nanoseconds"
                )
            stamp = round(float(time) * 1e9)
        else:
            stamp = int(time)
            if self._last_ns is not None and 0 < stamp - self._last_ns < _LEAST_STEP_NS:
                raise InputError(
                    f"time is the integer {time}, {stamp - self._last_ns} ns after the last: integers are "
                    f"nanoseconds. Give seconds as a float: time=number / frames_per_second"
                )
        self._last_ns = stamp
        return stamp

    def _make_frame(self, values: NDArray[Any], camera: Camera | None, stamp_ns: int) -> DepthFrame:
        if values.dtype.kind not in "uif":
            raise InputError(f"depth has dtype {values.dtype}; it must be integers or floats")
        if values.ndim in (2, 3) and values.shape[-1] == 3 and (values.ndim == 3 or camera is None):
            return self._frame_of_cloud(values, camera, stamp_ns)
        image = values[..., 0] if values.ndim == 3 and values.shape[-1] == 1 else values
        camera = _check_camera(image, camera)
        return DepthFrame(stamp_ns, self._frame_id, self._to_metres(image), camera)

    def _frame_of_cloud(self, points: NDArray[Any], camera: Camera | None, stamp_ns: int) -> DepthFrame:
        if points.dtype.kind != "f":
            raise InputError(
                f"depth has shape {points.shape} and dtype {points.dtype}: a point cloud is float metres, "
                "and a depth image has one channel (a colour image has no depth)"
            )
        if camera is not None:
            raise InputError(
                f"depth has shape {points.shape}, a point cloud, which has no camera: leave it out"
            )
        scale = self._depth_scale or 1.0
        points = points.astype(np.float32, order="C") * np.float32(scale)
        self._check_unit(points[..., 2], points.dtype, scale)
        frame = frame_from_cloud(points, stamp_ns, self._frame_id)
        if frame.frame_id != self._frame_id:
            self._notes = (f"{BODY_AXES}{frame.frame_id}",)
        return frame

    def _to_metres(self, image: NDArray[Any]) -> NDArray[np.float32]:
        if image.dtype.itemsize == 1 and self._depth_scale is None:
            raise InputError(
                f"depth has dtype {image.dtype}, at most {np.iinfo(image.dtype).max} mm: it is a picture of "
                "depth, not depth. If it is depth, give Tracker its unit in metres, say depth_scale=0.02"
            )
        scale = self._depth_scale or (1.0 if image.dtype.kind == "f" else INTEGER_UNIT_M)
        depth = in_metres(image, scale)
        if _is_negative(depth):
            self._notes = ("most depths are below 0 and count as missing: negate them if z points backward",)
        depth[~(np.isfinite(depth) & (depth > 0))] = 0.0
        self._check_unit(depth, image.dtype, scale)
        return depth

    def _check_unit(self, depth: NDArray[np.float32], dtype: np.dtype[Any], scale: float) -> None:
        """Reject depth whose median no indoor sensor has; once one image has passed, the unit is known."""
        if self._is_unit_known or (median := median_depth(depth)) is None:
            return
        if not is_indoors(median):
            raise InputError(_wrong_unit(median, dtype, scale))
        self._is_unit_known = True


def _is_negative(depth: NDArray[np.float32]) -> bool:
    """Whether most measured depths are negative; one constant negative value only marks holes."""
    below = depth[np.isfinite(depth) & (depth < 0.0)]
    measured = np.count_nonzero(np.isfinite(depth) & (depth != 0.0))
    return bool(2 * below.size > measured and np.ptp(below) > 0.0)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


def _check_camera(image: NDArray[Any], camera: Camera | None) -> Camera:
    """Return the camera of a depth image, with plain numbers, after checking that the two match."""
    if image.ndim != 2:
        raise InputError(f"depth has shape {image.shape}; an image has (height, width), a cloud (N, 3)")
    if not isinstance(camera, Camera):
        given = "a depth image needs its camera" if camera is None else f"camera is a {type(camera).__name__}"
        raise InputError(f"{given}: give a depth_pose.Camera, for instance {_CAMERA_CALL}")
    height, width = image.shape
    if (height, width) != (camera.height, camera.width):
        turned = "; it looks transposed" if (width, height) == (camera.height, camera.width) else ""
        raise InputError(
            f"depth has {height} rows and {width} columns, but the camera's image has {camera.height} and "
            f"{camera.width}{turned}. An image that was resized or cropped has another camera"
        )
    return camera_from_info(camera.matrix(), (), camera.width, camera.height)


def _wrong_unit(median_m: float, dtype: np.dtype[Any], scale: float) -> str:
    """Explain why the depth's unit does not match its type."""
    value = median_m / scale
    if dtype.kind != "f":
        unit, example = "millimetres", "depth_scale=0.0002 for 1/5 mm"
    elif 100.0 <= value <= 2e4:
        unit, example = "metres", "depth_scale=0.001: these look like millimetres"
        if value < _MOST_CENTIMETRES:
            example += ", or like centimetres (0.01)"
    else:
        unit, example = "metres", "depth_scale=0.001 for millimetres"
    return (
        f"depth is {dtype}, so {unit}, but its median is {value:.6g} {unit}, which no sensor sees indoors. "
        f"Give Tracker the unit in metres, {example} (depth_scale={scale:g} if they are {unit} all the same)"
    )
