"""The library's examples, run on recorded arrays."""

from __future__ import annotations

import importlib.util
import socket
import sys
from ctypes import POINTER, c_uint16
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from depth_pose.core.frame import DepthFrame
from depth_pose.core.open3d import load_open3d
from depth_pose.detect.sample_frame import sample_frame
from depth_pose.io.mcap_write import DepthWriter
from osc_reader import read_osc

o3d = load_open3d()  # before the examples import it themselves

EXAMPLES = Path(__file__).parents[1] / "examples" / "library"
STEP_S = 0.04


def example(name: str) -> ModuleType:
    """Load an example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(autouse=True)
def small_bank(bank_path, monkeypatch):
    monkeypatch.setenv("DEPTH_POSE_BANK", str(bank_path))


@pytest.fixture(scope="module")
def frame() -> DepthFrame:
    return sample_frame()


@pytest.fixture(scope="module")
def depth_mm(frame) -> np.ndarray:
    return np.round(1000 * frame.depth).astype(np.uint16)


def test_numpy_array(tmp_path, frame, depth_mm, capsys):
    times = STEP_S * np.arange(3)
    np.savez(tmp_path / "walk.npz", depth=[depth_mm] * 3, times=times, K=frame.camera.matrix())
    example("numpy_array").main(str(tmp_path / "walk.npz"))
    table = np.load(tmp_path / "walk_skeletons.npy")
    assert table["body_id"].tolist() == ["body_1"] * 3
    np.testing.assert_allclose(table["stamp_ns"] * 1e-9, times)
    assert table["positions"].shape == (3, 19, 3)
    assert capsys.readouterr().out.count("left wrist at") == 3


def test_open3d_images_and_clouds(tmp_path, frame, depth_mm, capsys):
    for number in range(2):
        Image.fromarray(depth_mm).save(tmp_path / f"{number}.png")
    camera = frame.camera
    lens = o3d.camera.PinholeCameraIntrinsic(
        camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
    )
    o3d.io.write_pinhole_camera_intrinsic(str(tmp_path / "camera.json"), lens)
    points = o3d.utility.Vector3dVector(camera.back_project(frame.depth).reshape(-1, 3))
    o3d.io.write_point_cloud(str(tmp_path / "cloud.ply"), o3d.geometry.PointCloud(points))
    example("open3d_images").main(str(tmp_path))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == [f"frame {n}  body_1" for n in range(3)]
    heads = np.array([line.split()[-4:-1] for line in lines], float)
    np.testing.assert_allclose(heads, heads[:1].repeat(3, axis=0), atol=0.05)


def recorded_sdk(frame: DepthFrame, depth_mm: np.ndarray, count: int) -> SimpleNamespace:
    """Supply recorded frames the way librealsense's Python module does."""
    camera = frame.camera
    lens = SimpleNamespace(
        width=camera.width, height=camera.height, fx=camera.fx, fy=camera.fy, ppx=camera.cx, ppy=camera.cy
    )
    stream = SimpleNamespace(as_video_stream_profile=lambda: SimpleNamespace(get_intrinsics=lambda: lens))
    sensor = SimpleNamespace(get_depth_scale=lambda: 0.001)
    profile = SimpleNamespace(
        get_device=lambda: SimpleNamespace(first_depth_sensor=lambda: sensor), get_stream=lambda which: stream
    )

    class Pipeline:
        left = count

        def start(self, config):
            return profile

        def wait_for_frames(self):
            if not self.left:
                raise KeyboardInterrupt
            self.left -= 1
            milliseconds = 1000 * STEP_S * (count - self.left)
            image = SimpleNamespace(get_data=lambda: depth_mm, get_timestamp=lambda: milliseconds)
            return SimpleNamespace(get_depth_frame=lambda: image)

        def stop(self):
            pass

    return SimpleNamespace(
        pipeline=Pipeline,
        config=lambda: SimpleNamespace(enable_stream=lambda *arguments: None),
        stream=SimpleNamespace(depth="depth"),
        format=SimpleNamespace(z16="z16"),
    )


def test_realsense(frame, depth_mm, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", recorded_sdk(frame, depth_mm, 2))
    with pytest.raises(KeyboardInterrupt):
        example("realsense").main()
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["body_1 left_wrist", "body_1 right_wrist"] * 2


def test_live_plot(tmp_path, frame, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    with DepthWriter(tmp_path / "in.mcap", frame.camera, "optical") as writer:
        for number in range(2):
            writer.write(40_000_000 * number, frame.depth)
    plot = example("live_plot")
    plot.main(plot.recorded(tmp_path / "in.mcap"), tmp_path / "last.png")
    picture = np.asarray(Image.open(tmp_path / "last.png").convert("RGB")).astype(int)
    orange = (abs(picture - [255, 165, 0]) < 40).all(axis=2)
    assert orange.sum() > 200  # the skeleton's lines


def test_openni2(frame, depth_mm, capsys, monkeypatch):
    """Frames as OpenNI2 gives them, fed from an array; what it sends is read by another reader of OSC."""
    camera = frame.camera
    left = 2

    class Stream:
        def start(self):
            pass

        def get_video_mode(self):
            return SimpleNamespace(resolutionX=camera.width, resolutionY=camera.height)

        def get_horizontal_fov(self):
            return 2.0 * np.arctan(0.5 * camera.width / camera.fx)

        def get_vertical_fov(self):
            return 2.0 * np.arctan(0.5 * camera.height / camera.fy)

        def read_frame(self):
            nonlocal left
            if not left:
                raise KeyboardInterrupt
            left -= 1
            return SimpleNamespace(
                timestamp=40_000 * (2 - left),
                width=camera.width,
                height=camera.height,
                get_buffer_as_uint16=lambda: (
                    depth_mm.ctypes.data_as(POINTER(c_uint16 * depth_mm.size)).contents
                ),
            )

    device = SimpleNamespace(create_depth_stream=Stream)
    sdk = SimpleNamespace(initialize=lambda: None, Device=SimpleNamespace(open_any=lambda: device))
    monkeypatch.setitem(sys.modules, "openni", SimpleNamespace(openni2=sdk))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(20.0)
        with pytest.raises(KeyboardInterrupt):
            example("openni2").main(["--osc", str(receiver.getsockname()[1])])
        assert list(read_osc(receiver.recv(65536))) == [("/depth_pose/people", ["body_1"])]
        assert len(list(read_osc(receiver.recv(65536)))) == 20
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[4] for line in lines] == ["body_1", "body_1"]
