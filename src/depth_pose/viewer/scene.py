"""Objects shown in the browser: points, skeletons, bodies, floor, camera, trails."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.camera import Camera
from depth_pose.core.result import Skeleton
from depth_pose.core.skeleton import BONES, JOINT_INDEX, JOINTS, JointState
from depth_pose.viewer import colours
from depth_pose.viewer.frames import ViewerFrame, owners
from depth_pose.viewer.frusta import RoomCameras, add_frustum, pose_node
from depth_pose.viewer.known_room import KnownRoom

Array = NDArray[np.float64]

_JOINT_M, _HIDDEN_M = 0.035, 0.026
"""Radii of visible and of hidden joints, metres."""
_BONE_M = 0.016
"""Thickness of bones, metres; for readability."""
_TRAIL_S = 1.5
"""Duration of the trails of hands, seconds; for readability."""
_POINT_M = 0.012
"""Size of points, metres; for readability."""
_HANDS = (JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"])
_OLD_LIGHT = 0.6
"""Brightness of people from an earlier frame."""
_NOTHING = 1e-4
"""Size of invisible objects."""

_T_LEVEL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Rotation from a level camera to REP-103's axes, used until the floor is known."""


@dataclass
class Wishes:
    """Visibility of the parts of the scene."""

    points: bool = True
    skeletons: bool = True
    names: bool = True
    bodies: bool = False
    trails: bool = False
    floor: bool = True
    camera: bool = True


class Scene:
    """The objects in a viser scene; each is created once and then updated.

    Parameters
    ----------
    server : viser.ViserServer
    mesh_of : callable, optional
        Returns vertices (V, 3) and faces (F, 3) of a person's fitted body; without it no bodies are shown.
    room : KnownRoom, optional
        Pose of the sensor, and all cameras; without it, only the sensor is drawn.
    """

    def __init__(
        self,
        server: Any,
        mesh_of: Callable[[Skeleton], tuple[Array, NDArray[np.int32]]] | None = None,
        room: KnownRoom | None = None,
    ) -> None:
        self.wishes = Wishes()
        self._server = server
        self._mesh_of = mesh_of
        self._people: dict[str, _PersonView] = {}
        self._trails: dict[str, deque[tuple[int, Array]]] = {}
        self._camera: Camera | None = None
        self._root = server.scene.add_frame("/sensor", show_axes=False)
        self._cloud = server.scene.add_point_cloud(
            "/sensor/points", np.zeros((1, 3), np.float32), (90, 90, 90), point_size=_POINT_M
        )
        self._cloud.point_shape = "rounded"
        self._grid = server.scene.add_grid(
            "/floor",
            12.0,
            12.0,
            position=(3.0, 0.0, 0.0),
            cell_size=0.5,
            cell_color=(70, 76, 88),
            section_color=(105, 112, 126),
        )
        self._frustum: Any = None
        self._cameras = RoomCameras(server, room.cameras) if room is not None else None
        self._is_odd = False
        self._has_floor = False
        self._turn(_T_LEVEL)
        self._grid.visible = False
        if room is not None:
            self.place(room.T_room_sensor)

    def place(self, T_world_camera: Array) -> None:
        """Place the sensor above the floor."""
        self._turn(T_world_camera)
        self._has_floor = True
        self._grid.visible = self.wishes.floor

    def _turn(self, T_world_camera: Array) -> None:
        pose_node(self._root, T_world_camera)
        self.T_world_camera = T_world_camera

    def show(self, frame: ViewerFrame, skeletons: tuple[Skeleton, ...]) -> None:
        """Draw a frame with some of its people."""
        with self._server.atomic():
            self._show_camera(frame.camera)
            self._show_points(frame, skeletons)
            seen = {s.body_id for s in skeletons}
            for gone in self._people.keys() - seen:
                self._people.pop(gone).remove()
                self._trails.pop(gone, None)
            for skeleton in skeletons:
                view = self._people.get(skeleton.body_id)
                if view is None:
                    view = self._people[skeleton.body_id] = _PersonView(self._server, skeleton.body_id)
                view.show(skeleton, self.wishes, self._mesh_of, skeleton.stamp_ns == frame.stamp_ns)
                view.show_trail(self._trail(skeleton), self.wishes.trails)

    def settle(self) -> None:
        """Make the browser redraw, because it places names and new objects one picture late."""
        self._is_odd = not self._is_odd
        self._cloud.point_size = _POINT_M * (1.0 + 1e-4 * self._is_odd)

    def forget_trails(self) -> None:
        """Drop the trails after a jump in time."""
        self._trails.clear()

    def _trail(self, skeleton: Skeleton) -> list[Array]:
        """Positions of the hands within the last `_TRAIL_S`, (2, 3) each."""
        trail = self._trails.setdefault(skeleton.body_id, deque())
        if trail and not 0 <= skeleton.stamp_ns - trail[-1][0] < 5e8:
            trail.clear()
        trail.append((skeleton.stamp_ns, skeleton.positions[list(_HANDS)]))
        while skeleton.stamp_ns - trail[0][0] > _TRAIL_S * 1e9:
            trail.popleft()
        return [hands for _, hands in trail]

    def _show_camera(self, camera: Camera) -> None:
        if self._cameras is not None:
            self._cameras.show(self.wishes.camera)
        elif camera != self._camera:
            self._camera, self._frustum = camera, add_frustum(self._server, "/sensor/camera", camera)
        if self._frustum is not None:
            self._frustum.visible = self.wishes.camera
        self._grid.visible = self.wishes.floor and self._has_floor

    def _show_points(self, frame: ViewerFrame, skeletons: tuple[Skeleton, ...]) -> None:
        self._cloud.visible = self.wishes.points
        if not self.wishes.points:
            return
        points = frame.points()
        colour = colours.of_distance(points)
        owner = owners(points, skeletons)
        for number, skeleton in enumerate(skeletons):
            mine = owner == number
            shade = colour[mine].astype(np.float32) / 196.0
            colour[mine] = np.clip(colours.of_person(skeleton.body_id) * shade, 0, 255).astype(np.uint8)
        if not len(points):
            points, colour = np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
        self._cloud.points, self._cloud.colors = points, colour


class _PersonView:
    """One person in the scene."""

    def __init__(self, server: Any, body_id: str) -> None:
        self._scene = server.scene
        self._path = "/sensor/people/" + "".join(c if c.isalnum() or c in "_-" else "_" for c in body_id)
        self._body_id = body_id
        ball, faces = _ball()
        none = np.zeros((len(JOINTS), 3), np.float32)
        turns = np.tile(np.array([1.0, 0, 0, 0], np.float32), (len(JOINTS), 1))
        common = {"batched_colors": (200, 200, 200), "lod": "off", "cast_shadow": False}
        add = self._scene.add_batched_meshes_simple
        self._joints = add(f"{self._path}/joints", ball, faces, turns, none, **common)
        self._hidden = add(f"{self._path}/hidden", ball, faces, turns, none, wireframe=True, **common)
        self._bones = self._scene.add_line_segments(
            f"{self._path}/bones", np.zeros((len(BONES), 2, 3), np.float32), (0, 0, 0), thickness=_BONE_M
        )
        self._name = self._scene.add_label(f"{self._path}/name", body_id, anchor="bottom-center")
        self._mesh: Any = None
        self._trail: Any = None

    def remove(self) -> None:
        """Remove the person from the scene."""
        for handle in (self._joints, self._hidden, self._bones, self._name, self._mesh, self._trail):
            if handle is not None:
                handle.remove()

    def show(self, skeleton: Skeleton, wishes: Wishes, mesh_of: Any, is_new: bool) -> None:
        """Draw the person: hidden joints hollow and smaller, colours by confidence.

        People from an earlier frame are darker.
        """
        for handle in (self._joints, self._hidden, self._bones):
            handle.visible = wishes.skeletons
        self._name.visible = wishes.names
        at = skeleton.positions.astype(np.float32)
        light = 1.0 if is_new else _OLD_LIGHT
        colour = colours.as_light((light * colours.of_confidence(skeleton.joint_confidence)).astype(np.uint8))
        seen = skeleton.joint_states == JointState.SEEN
        for handle, which, size in ((self._joints, seen, _JOINT_M), (self._hidden, ~seen, _HIDDEN_M)):
            handle.batched_positions, handle.batched_colors = at, colour
            handle.batched_scales = np.where(which, size, _NOTHING).astype(np.float32)
        ends = np.array(BONES)
        sure = skeleton.joint_confidence[ends].min(axis=1)
        self._bones.points = at[ends]
        mine = colours.of_person(skeleton.body_id).astype(np.float32)
        shade = light * (0.35 + 0.65 * np.clip(np.nan_to_num(sure), 0, 1))[:, None] * mine
        self._bones.colors = np.repeat(colours.as_light(shade.astype(np.uint8))[:, None], 2, axis=1)
        self._name.position = tuple((at[JOINT_INDEX["head"]] + (0, -0.25, 0)).tolist())
        self._show_mesh(skeleton, wishes.bodies and mesh_of is not None, mesh_of)

    def _show_mesh(self, skeleton: Skeleton, wanted: bool, mesh_of: Any) -> None:
        if not wanted:
            if self._mesh is not None:
                self._mesh.visible = False
            return
        vertices, faces = mesh_of(skeleton)
        if self._mesh is None:
            self._mesh = self._scene.add_mesh_simple(
                f"{self._path}/body",
                vertices.astype(np.float32),
                faces,
                color=tuple(int(c) for c in colours.of_person(self._body_id)),
                opacity=0.55,
            )
        self._mesh.vertices, self._mesh.visible = vertices.astype(np.float32), True

    def show_trail(self, hands: list[Array], wanted: bool) -> None:
        """Draw the trails of the hands."""
        if not wanted or len(hands) < 2:
            if self._trail is not None:
                self._trail.visible = False
            return
        way = np.stack(hands).astype(np.float32)
        lines = np.stack([way[:-1], way[1:]], axis=2).reshape(-1, 2, 3)
        colour = np.tile(colours.as_light(colours.of_person(self._body_id)), (len(lines), 2, 1))
        if self._trail is None:
            self._trail = self._scene.add_line_segments(f"{self._path}/trail", lines, colour, thickness=0.01)
        self._trail.points, self._trail.colors, self._trail.visible = lines, colour, True


def _ball() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices and faces of a round body of 42 vertices: an icosahedron, divided once."""
    g = (1 + 5**0.5) / 2
    corners = [(a, b * g, 0.0) for a in (-1, 1) for b in (-1, 1)]
    vertices = [tuple(np.roll(c, k)) for k in range(3) for c in corners]
    v = [np.array(p) / np.linalg.norm(p) for p in vertices]
    edge = 1.06
    faces = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if max(np.linalg.norm(v[a] - v[b]) for a, b in ((i, j), (j, k), (i, k))) < edge
    ]
    middles: dict[tuple[int, int], int] = {}

    def middle(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in middles:
            middles[key] = len(v)
            v.append((v[a] + v[b]) / np.linalg.norm(v[a] + v[b]))
        return middles[key]

    small = []
    for i, j, k in faces:
        if np.dot(np.cross(v[j] - v[i], v[k] - v[i]), v[i]) < 0:
            j, k = k, j
        a, b, c = middle(i, j), middle(j, k), middle(k, i)
        small += [(i, a, c), (a, j, b), (c, b, k), (a, b, c)]
    return np.array(v, np.float32), np.array(small, np.uint32)
