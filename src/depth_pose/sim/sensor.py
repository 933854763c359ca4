"""A virtual depth sensor: Open3D ray casting of triangle meshes, then the noise of a real one.

Values are set by hand; ranges are drawn from at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.open3d import load_open3d
from depth_pose.sim.noise import NO_NOISE, NoiseConfig, add_noise
from depth_pose.sim.stereo import StereoConfig, measure_stereo

Mesh = tuple[NDArray[np.floating], NDArray[np.integer]]
"""Vertices (V, 3), camera frame, metres; and faces (F, 3)."""

_OCCLUSION_SLACK_M = 0.02
"""Tolerance of the projector's ray in front of the surface that it lights, metres."""


@dataclass(frozen=True)
class SensorModel:
    """A kind of depth sensor.

    Attributes
    ----------
    name : str
    camera : Camera
    fps : float
        Frames per second.
    near, far : float
        Range that it measures, metres.
    projector_offset : float
        Structured light: offset of the projector to the left of the camera, metres; surfaces that it
        cannot reach are in shadow. 0 for none.
    noise : NoiseConfig
        Noise of each pixel by itself.
    stereo : StereoConfig, optional
        Matching of stereo cameras; their pixels have no other noise.
    """

    name: str
    camera: Camera
    fps: float
    near: float
    far: float
    projector_offset: float
    noise: NoiseConfig
    stereo: StereoConfig | None = None

    def with_width(self, width: int) -> SensorModel:
        """Return the same sensor with another image width and the same field of view."""
        c = self.camera
        factor = width / c.width
        # pixel centres are whole numbers: the image begins half a pixel before the first
        cx, cy = (c.cx + 0.5) * factor - 0.5, (c.cy + 0.5) * factor - 0.5
        camera = Camera(width, round(c.height * factor), c.fx * factor, c.fy * factor, cx, cy)
        stereo = None if self.stereo is None else self.stereo.scaled(factor)
        return replace(self, camera=camera, stereo=stereo)


def _stereo(name: str, camera: Camera, near: float, far: float, stereo: StereoConfig) -> SensorModel:
    return SensorModel(name, camera, 30.0, near, far, 0.0, NO_NOISE, stereo)


_STRUCTURED = SensorModel(
    name="structured",
    camera=Camera(640, 480, 575.0, 575.0, 319.5, 239.5),
    fps=30.0,
    near=0.5,
    far=6.0,
    projector_offset=0.075,
    noise=NoiseConfig(
        constant=0.0008,
        quadratic=0.0014,
        grazing_power=1.0,
        flying=0.15,
        edge_loss=0.35,
        dropout=0.004,
        grazing_limit=78.0,
        disparity_step=0.00285,
    ),
)

SENSORS: dict[str, SensorModel] = {
    "tof": SensorModel(
        name="tof",
        camera=Camera(176, 144, 225.0, 225.0, 87.5, 71.5),
        fps=25.0,
        near=0.3,
        far=7.5,
        projector_offset=0.0,
        noise=NoiseConfig(constant=0.002, quadratic=0.0014, grazing_power=1.0, flying=0.5, dropout=0.002),
    ),
    "structured": _STRUCTURED,
    "kinect_v1": replace(_STRUCTURED, name="kinect_v1"),
    "xtion": replace(
        _STRUCTURED,
        name="xtion",
        camera=Camera(640, 480, 570.3, 570.3, 319.5, 239.5),
        noise=replace(_STRUCTURED.noise, disparity_step=0.0029),
    ),
    "kinect_v2": SensorModel(
        name="kinect_v2",
        camera=Camera(512, 424, 365.5, 365.5, 255.5, 211.5),
        fps=30.0,
        near=0.5,
        far=8.0,
        projector_offset=0.0,
        noise=NoiseConfig(constant=0.0015, quadratic=0.0004, grazing_power=1.0, flying=0.4, dropout=0.001),
    ),
    "azure_kinect": SensorModel(
        name="azure_kinect",
        camera=Camera(640, 576, 504.0, 504.0, 319.5, 287.5),
        fps=30.0,
        near=0.5,
        far=5.5,
        projector_offset=0.0,
        noise=NoiseConfig(
            constant=0.001, quadratic=0.0003, grazing_power=1.0, flying=0.05, edge_loss=0.5, dropout=0.001
        ),
    ),
    "d435": _stereo(
        "d435", Camera(640, 480, 385.0, 385.0, 319.5, 239.5), 0.2, 6.0, StereoConfig(baseline=0.05)
    ),
    "d455": _stereo(
        "d455", Camera(640, 480, 385.0, 385.0, 319.5, 239.5), 0.4, 8.0, StereoConfig(baseline=0.095)
    ),
    "oak_d": _stereo(
        "oak_d",
        Camera(640, 400, 441.0, 441.0, 319.5, 199.5),
        0.35,
        8.0,
        StereoConfig(
            baseline=0.075,
            window=9,
            error=0.12,
            blob=9.0,
            step=1 / 8,
            lost=0.3,
            edge_loss=0.4,
            smoothing=0.0,
            temporal=0.0,
        ),
    ),
    "zed": _stereo(
        "zed",
        Camera(672, 376, 336.0, 336.0, 335.5, 187.5),
        0.3,
        8.0,
        StereoConfig(
            baseline=0.12,
            window=13,
            fattening=0.8,
            error=0.15,
            blob=20.0,
            step=1 / 16,
            lost=0.02,
            edge_loss=0.02,
            smoothing=0.8,
            smooth_step=2.0,
            fill=2,
        ),
    ),
}
"""The sensors by name: a small time-of-flight camera; structured light, in general and as made; two Kinects
with time of flight (the Azure in its narrow mode); stereo cameras. Fields of view, ranges and baselines are
those of the makers' data sheets; the noise of each is set by hand after published measurements."""


class VirtualSensor:
    """Renders meshes to depth as a real sensor would measure them.

    Parameters
    ----------
    model : SensorModel
        The kind of sensor.
    seed : int
        Of the noise; same seed, same images.
    """

    def __init__(self, model: SensorModel, seed: int = 0) -> None:
        self.model = model
        self._rng = np.random.default_rng(seed)
        camera = model.camera
        self._directions = camera.back_project(np.ones((camera.height, camera.width), np.float32))
        self._lengths = np.linalg.norm(self._directions, axis=-1)

    def render(self, meshes: Sequence[Mesh]) -> NDArray[np.float32]:
        """Measure a scene.

        Parameters
        ----------
        meshes : sequence of (vertices, faces)
            Camera frame, metres.

        Returns
        -------
        (H, W) float32
            Metres; 0 where nothing returns.
        """
        depth, incidence_cos = self._cast(_scene(meshes))
        stereo = self.model.stereo
        if stereo is None:
            return add_noise(depth, incidence_cos, self.model.noise, self._rng)
        light = np.sqrt(np.maximum(incidence_cos, np.float32(0.05)))
        measured = measure_stereo(depth, light, self.model.camera.fx, stereo, self._rng)
        in_range = (measured >= self.model.near) & (measured <= self.model.far)
        millimetres = np.rint(measured * np.float32(1000.0))
        return np.where(in_range, millimetres / np.float32(1000.0), np.float32(0.0)).astype(np.float32)

    def _cast(self, scene: Any) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Depth and cosine of the incidence angle, both (H, W)."""
        from open3d import core

        rays = np.concatenate([np.zeros_like(self._directions), self._directions], axis=-1)
        hit = scene.cast_rays(core.Tensor(rays))
        depth = hit["t_hit"].numpy()
        depth = np.where((depth >= self.model.near) & (depth <= self.model.far), depth, 0).astype(np.float32)
        along = np.abs(np.einsum("hwc,hwc->hw", self._directions, hit["primitive_normals"].numpy()))
        if self.model.projector_offset:
            depth[self._in_shadow(scene, depth)] = 0.0
        return depth, (along / self._lengths).astype(np.float32)

    def _in_shadow(self, scene: Any, depth: NDArray[np.float32]) -> NDArray[np.bool_]:
        from open3d import core

        projector = np.array([-self.model.projector_offset, 0.0, 0.0], np.float32)
        toward = self._directions * depth[..., None] - projector
        rays = np.concatenate([np.broadcast_to(projector, toward.shape), toward], axis=-1)
        # t = 1 is the surface itself
        reach = 1.0 - _OCCLUSION_SLACK_M / np.maximum(float(depth.max()), 1.0)
        shadow = scene.test_occlusions(core.Tensor(np.ascontiguousarray(rays)), 0.0, reach).numpy()
        return np.asarray(shadow & (depth > 0))

    def sees(
        self, points: NDArray[np.floating], meshes: Sequence[Mesh], depth_inside: float
    ) -> NDArray[np.bool_]:
        """Find the points inside a body whose near side the camera sees.

        Parameters
        ----------
        points : (N, 3) float
            Camera frame, metres; joints, which lie below the skin.
        meshes : sequence of (vertices, faces)
            The scene, camera frame, metres.
        depth_inside : float
            Maximum distance of a seen point behind the first surface on its ray, metres.

        Returns
        -------
        (N,) bool
            False too for points outside the image.
        """
        from open3d import core

        camera = self.model.camera
        u, v = camera.project(np.maximum(points, [-np.inf, -np.inf, 1e-6])).T
        inside = (u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5)
        inside &= points[:, 2] > 0
        directions = points / np.linalg.norm(points, axis=1, keepdims=True)
        rays = np.concatenate([np.zeros_like(directions), directions], axis=1).astype(np.float32)
        first = _scene(meshes).cast_rays(core.Tensor(rays))["t_hit"].numpy()
        return np.asarray(inside & (first > np.linalg.norm(points, axis=1) - depth_inside))


def _scene(meshes: Sequence[Mesh]) -> Any:
    """Build an Open3D ray-casting scene from meshes."""
    open3d = load_open3d()

    scene = open3d.t.geometry.RaycastingScene()
    for vertices, faces in meshes:
        if len(faces):
            scene.add_triangles(
                open3d.core.Tensor(np.ascontiguousarray(vertices, np.float32)),
                open3d.core.Tensor(np.ascontiguousarray(faces, np.uint32)),
            )
    return scene
