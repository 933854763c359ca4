"""Readers of public data sets, each a function of its folder that returns the clips, read when they are used.

UTD-MHAD (C. Chen et al., ICIP 2015). ``Depth/aA_sS_tT_depth.mat`` holds ``d_depth`` (240, 320, T),
millimetres of a Kinect v1; ``Skeleton/aA_sS_tT_skeleton.mat`` holds ``d_skel`` (20, 3, T), metres in the
Kinect SDK's axes. The tracker's joints are two frames late against the images.

MSR Action3D (W. Li et al., CVPR workshops 2010). ``aA_sS_eE_sdepth.bin``: three int32, the numbers of
frames, columns and rows, then int32 depth, row by row; its unit is not published, and is found from the
skeletons. ``aA_sS_eE_skeleton3D.txt``: 20 lines ``x y z confidence`` a frame, metres.

ITOP (A. Haque et al., ECCV 2016). ``ITOP_VIEW_test_depth_map.h5``: ``data`` (N, 240, 320) float16, metres;
``ITOP_VIEW_test_labels.h5``: ``is_valid`` (N,), ``visible_joints`` (N, 15), ``image_coordinates`` (N, 15,
2) and ``real_world_coordinates`` (N, 15, 3), metres. A pixel is .0035 of its distance wide.

EVAL (V. Ganapathi et al., ECCV 2012). ``seq_*.bin``, frames of 930,704 bytes, little endian: int32 magic,
int32 number, float32 (240, 320, 3) points in metres (x right, y up, z to the viewer), int32 number of
markers, 32 times a name of 256 bytes and float32 (3,), int32 number of joints, 32 times an int32 and
float32 (3,). The numbers of the joints are nowhere explained, so the markers are used.

SMMC-10 (V. Ganapathi et al., CVPR 2010). No description of its files was found, neither in the paper nor in
public code: convert each sequence to a recording ``NAME.mcap`` and a truth file ``NAME.npz`` (as of
``depth-pose eval``) with the markers' names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from depth_pose.core.camera import Camera
from depth_pose.core.errors import InputError
from depth_pose.evaluate.truth import load_truth
from depth_pose.io.mcap_read import DepthReader

Depth, Points = NDArray[np.float32], NDArray[np.float64]

KINECT_PX = 285.63
"""Focal length of a Kinect v1's depth images of 320 x 240 (px)."""
ITOP_PX = 1.0 / 0.0035
FPS = 30.0
LATE = 2
"""Frames by which the joints of UTD-MHAD are late against their images."""

UTD_JOINTS = (
    *("head", "neck", "spine", "pelvis", "left_shoulder", "left_elbow", "left_wrist", ""),
    *("right_shoulder", "right_elbow", "right_wrist", "", "left_hip", "left_knee", "left_ankle", "left_foot"),
    *("right_hip", "right_knee", "right_ankle", "right_foot"),
)
"""Names of our joints in the published order; empty for hands, which we do not have."""
MSR_JOINTS = (
    *("right_shoulder", "left_shoulder", "neck", "spine", "right_hip", "left_hip", "pelvis"),
    *("right_elbow", "left_elbow", "right_wrist", "left_wrist", "", "", "right_knee", "left_knee"),
    *("right_ankle", "left_ankle", "right_foot", "left_foot", "head"),
)
ITOP_JOINTS = (
    *("head", "neck", "right_shoulder", "left_shoulder", "right_elbow", "left_elbow", "right_wrist"),
    *("left_wrist", "spine", "right_hip", "left_hip", "right_knee", "left_knee", "right_ankle", "left_ankle"),
)
"""Its hands, torso and feet are our wrists, spine and ankles."""

_MARKER = np.dtype([("name", "S256"), ("place", "<f4", 3)])
EVAL_FRAME = np.dtype(
    [
        *[("magic", "<i4"), ("number", "<i4"), ("points", "<f4", (240, 320, 3)), ("count", "<i4")],
        *[("markers", _MARKER, 32), ("joint_count", "<i4")],
        ("joints", [("id", "<i4"), ("place", "<f4", 3)], 32),
    ]
)


@dataclass(frozen=True)
class Loaded:
    """A clip: depth images in metres, and what is known in the optical frame; NaN where it is not.

    Attributes
    ----------
    frames : iterator of (camera, depth)
    reference : (T, J, 3) float64
    names : tuple of str
        Names of joints, or of markers.
    """

    frames: Iterator[tuple[Camera, Depth]]
    reference: Points
    names: tuple[str, ...]


@dataclass(frozen=True)
class Clip:
    """A clip that is read when it is used.

    Attributes
    ----------
    kind : str
        What the reference is: joints, another tracker's joints, or markers.
    is_video : bool
        Whether its frames follow one another.
    """

    name: str
    load: Callable[[], Loaded]
    kind: str
    is_video: bool = True


def utd_mhad(folder: Path, view: str) -> list[Clip]:
    """Return the clips of UTD-MHAD."""
    return [
        Clip(path.name.removesuffix("_depth.mat"), partial(_load_utd, path), "tracker")
        for path in _files(folder, "a*_depth.mat")
    ]


def _load_utd(path: Path) -> Loaded:
    depth = np.moveaxis(loadmat(path)["d_depth"], 2, 0) * np.float32(1e-3)
    name = path.name.replace("_depth.mat", "_skeleton.mat")
    skeleton = next(iter(_files(path.parents[1], name)))
    joints = np.moveaxis(loadmat(skeleton)["d_skel"], 2, 0).astype(np.float64)[LATE:]
    return _kinect(depth, joints, UTD_JOINTS)


def msr_action3d(folder: Path, view: str) -> list[Clip]:
    """Return the clips of MSR Action3D that have a skeleton."""
    skeletons = {path.name: path for path in folder.rglob("a*_skeleton3D.txt")}
    clips = []
    for path in _files(folder, "a*_sdepth.bin"):
        skeleton = skeletons.get(path.name.replace("_sdepth.bin", "_skeleton3D.txt"))
        if skeleton is not None:
            name = path.name.removesuffix("_sdepth.bin")
            clips.append(Clip(name, partial(_load_msr, path, skeleton), "tracker"))
    return clips


def _load_msr(path: Path, skeleton: Path) -> Loaded:
    count, columns, rows = np.fromfile(path, "<i4", 3)
    units = np.fromfile(path, "<i4", offset=12).reshape(count, rows, columns)
    joints = np.loadtxt(skeleton)[:, :3].reshape(-1, 20, 3)
    unit = np.median(joints[..., 2]) / np.median(units[units > 0])
    return _kinect((units * unit).astype(np.float32), joints, MSR_JOINTS)


def _kinect(depth: Depth, joints: Points, names: tuple[str, ...]) -> Loaded:
    """Convert the Kinect SDK's axes (x to the left, y up) and mirrored images to an optical frame."""
    count = min(len(depth), len(joints))
    depth, joints = depth[:count], joints[:count] * (-1.0, -1.0, 1.0)
    rows, columns = depth.shape[1:]
    focal = KINECT_PX * columns / 320
    sides = [(depth, Camera(columns, rows, focal, focal, columns / 2, rows / 2))]
    sides.append((depth[..., ::-1], sides[0][1]._replace(cx=columns - 1 - columns / 2)))
    depth, camera = max(sides, key=lambda side: _share_on_body(*side, joints))
    if _share_on_body(depth, camera, joints) < 0.5:
        raise InputError("most published joints are not on the person: the files are not as described")
    known = [i for i, name in enumerate(names) if name]
    named = tuple(names[i] for i in known)
    return Loaded(((camera, image) for image in depth), joints[:, known], named)


def _share_on_body(depth: Depth, camera: Camera, joints: Points) -> float:
    """Return the share of joints before which there is depth."""
    pixels = np.rint(camera.project(joints.reshape(-1, 3))).astype(int).reshape(*joints.shape[:2], 2)
    u, v = pixels[..., 0], pixels[..., 1]
    inside = (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    frame = np.broadcast_to(np.arange(len(depth))[:, None], u.shape)
    at = depth[frame[inside], v[inside], u[inside]]
    near = np.abs(at - joints[..., 2][inside]) < 0.3
    return float(near.sum() / u.size)


def itop(folder: Path, view: str) -> list[Clip]:
    """Return the valid test frames of one view of ITOP, as one clip of single frames."""
    (path,) = _files(folder, f"ITOP_{view}_test_depth_map.h5")
    return [Clip(f"ITOP {view} test", partial(_load_itop, path), "joints", is_video=False)]


def _load_itop(path: Path) -> Loaded:
    try:
        import h5py
    except ImportError as error:
        raise InputError("the files of ITOP are HDF5; run: pip install h5py") from error
    with h5py.File(str(path).replace("_depth_map", "_labels")) as labels:
        valid = np.flatnonzero(labels["is_valid"][:])
        joints = labels["real_world_coordinates"][:].astype(np.float64)
        rows = labels["image_coordinates"][:][..., 1].astype(np.float64)
    y, row = joints[valid, :, 1].ravel(), rows[valid].ravel()
    if np.corrcoef(y, row)[0, 1] < 0.0:  # y is up
        joints[..., 1] *= -1.0

    def frames() -> Iterator[tuple[Camera, Depth]]:
        camera = Camera(320, 240, ITOP_PX, ITOP_PX, 160.0, 120.0)
        with h5py.File(path) as images:
            for i in valid:
                yield camera, images["data"][i].astype(np.float32)

    return Loaded(frames(), joints[valid], ITOP_JOINTS)


def eval_2012(folder: Path, view: str) -> list[Clip]:
    """Return the sequences of EVAL."""
    return [Clip(path.stem, partial(_load_eval, path), "markers") for path in _files(folder, "seq_*.bin")]


def _load_eval(path: Path) -> Loaded:
    if path.stat().st_size % EVAL_FRAME.itemsize:
        raise InputError(f"{path} does not consist of frames of {EVAL_FRAME.itemsize} bytes")
    data = np.memmap(path, EVAL_FRAME, mode="r")
    names = sorted({m["name"] for frame in data for m in frame["markers"][: frame["count"]]})
    index = {name: i for i, name in enumerate(names)}
    places = np.full((len(data), len(names), 3), np.nan)
    for t, frame in enumerate(data):
        for marker in frame["markers"][: frame["count"]]:
            places[t, index[marker["name"]]] = marker["place"]
    places *= (1.0, -1.0, -1.0)
    camera, is_mirrored = _fit_camera(data["points"][0])

    def frames() -> Iterator[tuple[Camera, Depth]]:
        for frame in data:
            depth = np.nan_to_num(-frame["points"][..., 2])
            yield camera, np.ascontiguousarray(depth[:, ::-1] if is_mirrored else depth)

    return Loaded(frames(), places, tuple(name.decode(errors="replace") for name in names))


def _fit_camera(points: Depth) -> tuple[Camera, bool]:
    """Fit the camera of organised points (H, W, 3); return whether its columns run against x."""
    rows, columns = points.shape[:2]
    z = -points[..., 2].astype(np.float64)
    v, u = np.nonzero(np.isfinite(z) & (z > 0.1))
    x, y = points[v, u, 0] / z[v, u], -points[v, u, 1] / z[v, u]
    is_mirrored = bool(np.corrcoef(x, u)[0, 1] < 0.0)
    fx, cx = np.polyfit(x, columns - 1 - u if is_mirrored else u, 1)
    fy, cy = np.polyfit(y, v, 1)
    return Camera(columns, rows, float(fx), float(fy), float(cx), float(cy)), is_mirrored


def converted(folder: Path, view: str) -> list[Clip]:
    """Return recordings with truth files beside them."""
    return [Clip(path.stem, partial(_load_converted, path), "markers") for path in _files(folder, "*.mcap")]


def _load_converted(path: Path) -> Loaded:
    known = load_truth(path.with_suffix(".npz"))
    frames = ((frame.camera, frame.depth) for frame in DepthReader(path))
    return Loaded(frames, known.joints, known.names)


def _files(folder: Path, pattern: str) -> list[Path]:
    found = sorted(folder.rglob(pattern))
    if not found:
        raise InputError(
            f"{folder} has no file {pattern}; see the head of {Path(__file__).name} for the formats"
        )
    return found


READERS = {
    "utd-mhad": utd_mhad,
    "itop": itop,
    "msr-action3d": msr_action3d,
    "eval": eval_2012,
    "smmc": converted,
}
