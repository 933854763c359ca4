"""The benchmark of public data sets reads tiny files of each published format, and finds what is in them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from depth_pose import Tracker
from depth_pose.core.camera import Camera
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import quat_to_matrix
from depth_pose.core.skeleton import JOINT_INDEX, JOINTS
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.io.mcap_write import DepthWriter

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
FRAMES = 4
OFFSET = np.array([0.02, -0.01, 0.015])

sys.path.insert(0, str(BENCHMARKS))
from parts import public_readers  # noqa: E402

Scene = tuple[np.ndarray, Skeleton]


@pytest.fixture(scope="module")
def scenes(bank) -> dict[float, Scene]:
    """By focal length: a depth image (240, 320) of a person, metres, and its skeleton."""
    made = {}
    for focal in (public_readers.KINECT_PX, public_readers.ITOP_PX):
        camera = Camera(320, 240, focal, focal, 160.0, 120.0)
        depth = seen_by(camera)
        (person,) = Tracker(bank, quiet=True)(depth, camera)
        made[focal] = depth, person
    return made


def seen_by(camera: Camera) -> np.ndarray:
    """The sample frame as another camera at the same place would see it."""
    frame = sample_frame()
    v, u = np.mgrid[: camera.height, : camera.width]
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    column = np.rint(x * frame.camera.fx + frame.camera.cx).astype(int)
    row = np.rint(y * frame.camera.fy + frame.camera.cy).astype(int)
    inside = (column >= 0) & (column < frame.camera.width) & (row >= 0) & (row < frame.camera.height)
    depth = np.zeros((camera.height, camera.width), np.float32)
    depth[inside] = frame.depth[row[inside], column[inside]]
    return depth


def published(person: Skeleton, names: tuple[str, ...]) -> np.ndarray:
    """Joints as another tracker would give them, each at the same offset; (J, 3)."""
    places = [person.positions[JOINT_INDEX[n]] + OFFSET if n else np.zeros(3) for n in names]
    return np.array(places)


def score(name: str, folder: Path, bank_path: Path, *more: str) -> dict[str, float]:
    """Run the benchmark; return the figures of all clips."""
    source = str(BENCHMARKS.parent / "src")
    path = os.pathsep.join(filter(None, [source, os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, BENCHMARKS / "public.py", name, folder, *more],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"PYTHONPATH": path, "DEPTH_POSE_BANK": str(bank_path)},
    )
    assert done.returncode == 0, done.stderr
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("all 1 clips"))
    found = re.fullmatch(
        r"all 1 clips: (\d+) frames, answered ([\d.]+), error ([\d.]+ mm|-), "
        r"(?:without offsets ([\d.]+) mm, )?mAP at 10 cm ([\d.]+)",
        line,
    )
    assert found, line
    frames, answered, error, free, within = found.groups()
    raw = np.nan if error == "-" else float(error.split()[0])
    values = map(float, (frames, answered, raw, free or np.nan, within))
    return dict(zip(("frames", "answered", "error", "free", "within"), values, strict=True))


def assert_found(told: dict[str, float], frames: int = FRAMES, joints: bool = False) -> None:
    """The whole clip was answered, and nothing but the constant offset is left; of joints that stays."""
    assert told["frames"] == frames and told["answered"] == 1.0 and told["within"] > 0.95
    assert not told["free"] > 15.0
    assert np.isnan(told["free"]) == joints
    if not np.isnan(told["error"]):
        assert abs(told["error"] - 1e3 * np.linalg.norm(OFFSET)) < 15.0


KINECT = (-1.0, -1.0, 1.0)


def test_utd_mhad(scenes: dict[float, Scene], tmp_path: Path, bank_path: Path) -> None:
    depth, person = scenes[public_readers.KINECT_PX]
    (tmp_path / "Depth").mkdir()
    (tmp_path / "Skeleton").mkdir()
    images = np.repeat((1e3 * depth[:, ::-1, None]).astype(np.uint16), FRAMES, axis=2)
    savemat(tmp_path / "Depth/a1_s2_t3_depth.mat", {"d_depth": images})
    joints = published(person, public_readers.UTD_JOINTS) * KINECT
    late = [joints + 1.0] * public_readers.LATE + [joints] * FRAMES
    savemat(tmp_path / "Skeleton/a1_s2_t3_skeleton.mat", {"d_skel": np.stack(late, axis=2)})
    assert_found(score("utd-mhad", tmp_path, bank_path))


def test_msr_action3d(scenes: dict[float, Scene], tmp_path: Path, bank_path: Path) -> None:
    depth, person = scenes[public_readers.KINECT_PX]
    unit = 1.0 / 180.0
    cut_out = np.where(depth < 3.6, depth, 0.0)[:, ::-1]  # as published, without the room
    joints = published(person, public_readers.MSR_JOINTS)
    joints[:, 2] += np.median(cut_out[cut_out > 0]) - np.median(joints[:, 2])
    rows = np.hstack([joints * KINECT, np.ones((20, 1))])
    np.savetxt(tmp_path / "a01_s02_e01_skeleton3D.txt", np.vstack([rows] * FRAMES))
    with (tmp_path / "a01_s02_e01_sdepth.bin").open("wb") as file:
        np.array([FRAMES, 320, 240], "<i4").tofile(file)
        np.repeat(np.rint(cut_out / unit)[None], FRAMES, axis=0).astype("<i4").tofile(file)
    told = score("msr-action3d", tmp_path, bank_path)
    assert told["answered"] == 1.0 and told["free"] < 15.0


def test_itop(scenes: dict[float, Scene], tmp_path: Path, bank_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    depth, person = scenes[public_readers.ITOP_PX]
    joints = published(person, public_readers.ITOP_JOINTS)
    pixels = joints[:, :2] / joints[:, 2:] * public_readers.ITOP_PX + (160.0, 120.0)
    with h5py.File(tmp_path / "ITOP_side_test_depth_map.h5", "w") as file:
        file["data"] = np.stack([np.zeros_like(depth), depth, depth]).astype(np.float16)
    with h5py.File(tmp_path / "ITOP_side_test_labels.h5", "w") as file:
        file["is_valid"] = np.array([0, 1, 1], np.uint8)
        file["visible_joints"] = np.ones((3, 15), np.int16)
        file["image_coordinates"] = np.stack([pixels] * 3).astype(np.int16)
        file["real_world_coordinates"] = np.stack([joints * (1.0, -1.0, 1.0)] * 3).astype(np.float16)
    assert_found(score("itop", tmp_path, bank_path), frames=2, joints=True)


def test_eval(scenes: dict[float, Scene], tmp_path: Path, bank_path: Path) -> None:
    depth, person = scenes[public_readers.KINECT_PX]
    camera = Camera(320, 240, public_readers.KINECT_PX, public_readers.KINECT_PX, 160.0, 120.0)
    data = np.zeros(FRAMES, public_readers.EVAL_FRAME)
    assert data.dtype.itemsize == 930_704
    data["points"] = camera.back_project(depth).reshape(240, 320, 3) * (1.0, -1.0, -1.0)
    data["count"] = 2
    for i, (name, joint) in enumerate((("head_front", "head"), ("l_wrist_out", "left_wrist"))):
        j = JOINT_INDEX[joint]
        place = person.positions[j] + quat_to_matrix(person.quats_xyzw)[j] @ (0.0, 0.03, 0.05)
        data["markers"]["name"][:, i] = name.encode()
        data["markers"]["place"][:, i] = place * (1.0, -1.0, -1.0)
    data.tofile(tmp_path / "seq_a_0.bin")
    assert_found(score("eval", tmp_path, bank_path))


def test_smmc(scenes: dict[float, Scene], tmp_path: Path, bank_path: Path) -> None:
    depth, person = scenes[public_readers.KINECT_PX]
    camera = Camera(320, 240, public_readers.KINECT_PX, public_readers.KINECT_PX, 160.0, 120.0)
    stamps = np.arange(1, FRAMES + 1) * 33_000_000
    with DepthWriter(tmp_path / "one.mcap", camera, "optical") as writer:
        for stamp in stamps:
            writer.write(int(stamp), depth)
    np.savez(
        tmp_path / "one.npz",
        joints=np.repeat(person.positions[None], FRAMES, axis=0),
        names=np.array(JOINTS),
        stamps_ns=stamps,
        seen=np.ones((FRAMES, len(JOINTS)), bool),
    )
    assert_found(score("smmc", tmp_path, bank_path))


def test_a_folder_without_the_files_is_named(tmp_path: Path) -> None:
    with pytest.raises(public_readers.InputError, match=r"has no file a\*_depth.mat"):
        public_readers.utd_mhad(tmp_path, "side")
