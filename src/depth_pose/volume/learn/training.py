"""Training by simulation: motions of several bodies in several garments, seen by virtual cameras.

A real dancer can be tracked if their motion is known beforehand, for instance from motion capture of the
same dance: the views of the cameras are simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from depth_pose.core.errors import ConfigError
from depth_pose.motion.clip import Clip
from depth_pose.motion.procedural.dance import DANCES, perform
from depth_pose.rooms.rig import RigCamera, look_at
from depth_pose.sim.clothing import find_garment
from depth_pose.sim.roof_cameras import MIDDLE_M, front_camera, roof_rig
from depth_pose.sim.wearers import Wearer
from depth_pose.volume.config import SpaceConfig
from depth_pose.volume.hull import SurfaceVoxels
from depth_pose.volume.learn.performances import TRAINING_SHAPES, Performance, rig_eyes, watch, watch_around

DEPTH_VIEWS = 16
"""Directions from which a depth camera may see the person: 22.5 degrees apart."""

INPUTS = ("silhouettes", "depth")

PERFORMANCES, EVERY = 10, 10
"""Performances of a dance for training, and step between their frames at 30 a second: some
350 frames in all, as many as the paper's. One performance of 350 is worse (docs/volume.md)."""

_FPS = 30.0
"""Frames a second of the motions, as the paper's."""


def default_wearers(garments: Sequence[str] = ("skirt", "long-skirt", "wide-skirt", "none")) -> list[Wearer]:
    """Return wearers of garments by name, in three builds; of several garments the last is worn twice."""
    found = [find_garment(name) for name in garments]
    wearers = [Wearer(TRAINING_SHAPES[i % len(TRAINING_SHAPES)], g) for i, g in enumerate(found)]
    if len(found) > 1:
        wearers.append(Wearer(TRAINING_SHAPES[(len(found) + 1) % len(TRAINING_SHAPES)], found[-1]))
    return wearers


def dance_clips(dance: str, performances: int = PERFORMANCES) -> list[Clip]:
    """Return performances of a dance for training, each about once through it."""
    if dance not in DANCES:
        raise ConfigError(f"there is no dance {dance!r}; there are {', '.join(DANCES)}")
    seconds = round(DANCES[dance].seconds * _FPS + 5) / _FPS
    return [perform(dance, 1 + i, seconds, _FPS) for i in range(performances)]


def simulate_views(
    clips: Sequence[Clip],
    wearers: Sequence[Wearer],
    kind: str = "silhouettes",
    every: int = EVERY,
    space: SpaceConfig | None = None,
    rig: Sequence[RigCamera] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[list[list[Performance]]]:
    """Simulate wearers who perform in front of the cameras.

    Parameters
    ----------
    clips : sequence of Clip
        Motions, within a metre of the origin.
    wearers : sequence of Wearer
    kind : str
        One of `INPUTS`.
    every : int
        Step between the frames used.
    space : SpaceConfig
    rig : sequence of RigCamera
        Silhouette cameras, by default eight under the roof; or depth cameras, of which only the mean height
        and distance from the middle are used.
    progress : callable, optional
        Called with the number of frames done, and of all.

    Returns
    -------
    list of lists of lists of Performance
        By view, wearer and clip, as `depth_pose.volume.learn.learning.learn_model` takes them.
    """
    if kind not in INPUTS:
        raise ConfigError(f"there is no input {kind!r}; it is one of {', '.join(INPUTS)}")
    total, done = sum(len(c) for c in clips) * len(wearers), 0

    def tell(frames: int) -> None:
        if progress is not None:
            progress(done + frames, total)

    space = space or SpaceConfig()
    if kind == "silhouettes":
        eyes = rig_eyes(kind, rig or roof_rig(), space)
        see = lambda clip, wearer: [watch(clip, wearer, eyes, every, tell)]  # noqa: E731
    else:
        camera, voxels = _typical(rig, space) if rig else front_camera(), SurfaceVoxels(space)
        see = lambda clip, wearer: watch_around(clip, wearer, camera, voxels, DEPTH_VIEWS, every, tell)  # noqa: E731
    people: list[list[list[Performance]]] = []
    for wearer in wearers:
        people.append([])
        for clip in clips:
            people[-1].append(see(clip, wearer))
            done += len(clip)
    views = len(people[0][0])
    return [[[clip[v] for clip in person] for person in people] for v in range(views)]


def _typical(rig: Sequence[RigCamera], space: SpaceConfig) -> RigCamera:
    """Return the first camera of a rig, at the mean height and distance of all of them."""
    places = np.array([c.position for c in rig]) - [space.centre_x, 0.0, space.centre_z]
    distance, height = float(np.hypot(places[:, 0], places[:, 2]).mean()), float(places[:, 1].mean())
    return RigCamera(rig[0].name, rig[0].camera, look_at([0.0, height, distance], MIDDLE_M))
