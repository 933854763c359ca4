"""The viewer's server: one loop that shows the newest frame, and its control panel."""

from __future__ import annotations

import asyncio
import io
import threading
import time
from collections.abc import Callable
from concurrent.futures import wait
from contextlib import redirect_stdout, suppress
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from depth_pose.core.config import FollowConfig
from depth_pose.core.errors import ConfigError, DepthPoseError
from depth_pose.core.extras import require
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import rotation_z
from depth_pose.core.zone import Zone, parse_zone
from depth_pose.track.follow import Follower
from depth_pose.viewer.access import own_pages_only
from depth_pose.viewer.frames import ViewerFrame
from depth_pose.viewer.rate_limit import RateLimit
from depth_pose.viewer.room import FloorSeeker
from depth_pose.viewer.scene import Scene, Wishes
from depth_pose.viewer.screenshots import free_name, save_gif, save_png
from depth_pose.viewer.source import LiveSource, RecordedSource
from depth_pose.viewer.tables import chosen, nodes_table, people_table

RATE_HZ = 15.0
"""Maximum frames drawn per second; fewer if a browser takes longer."""

_LOOK_S = 0.2
"""Seconds between two checks for the end of the viewer while a frame is drawn."""

_TABLE_S = 0.4
"""Time between two updates of the panel's table, seconds. For readability."""
_CLIP_HZ = 10.0
"""Frame rate of a saved clip. For smooth motion."""
_PICTURE = (960, 540)
"""Width and height of a saved picture, pixels; a clip has half of both."""
_RENDER_S = 60.0
"""Time limit for a browser's picture, seconds; one without a graphics card takes ten."""

_EYE, _TARGET = (-1.4, 1.5, 1.2), (2.8, -0.6, -0.5)
"""Viewpoint and target relative to the sensor: forward, left, up, metres; the panel covers the right."""

_FOLLOW = ("first", "nearest", "centre")
_SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
_CLIP_S = (1, 10)
"""Minimum and maximum length of a clip, seconds."""

_LABELS = {
    "points": "depth points",
    "skeletons": "skeletons",
    "names": "names",
    "bodies": "fitted bodies",
    "trails": "trails of hands",
    "floor": "floor",
    "camera": "camera",
}

Place = tuple[float, float, float]
MeshOf = Callable[[Skeleton], tuple[NDArray[np.float64], NDArray[np.int32]]]


class Viewer:
    """The browser viewer of a recording or of running nodes.

    Parameters
    ----------
    source : RecordedSource or LiveSource
    host, port
        Address for browsers; port 0 takes any.
    pictures : Path
        Folder of screenshots and clips.
    mesh_of : callable, optional
        Returns a person's fitted body.

    Attributes
    ----------
    server : viser.ViserServer
    source : RecordedSource or LiveSource
        The given source.
    frame : ViewerFrame or None
        The frame shown.
    drawn : int
        Number of frames drawn.
    rate_limit : RateLimit
        Limit of the frame rate for slow browsers.
    """

    def __init__(
        self,
        source: RecordedSource | LiveSource,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
        pictures: Path = Path("results"),
        mesh_of: MeshOf | None = None,
    ) -> None:
        require("viser", "the viewer")
        import viser

        with redirect_stdout(io.StringIO()), own_pages_only(host):  # printed by us
            self.server: Any = viser.ViserServer(host=host, port=port, label="depth_pose", verbose=False)
        self.source = source
        self.drawn = 0
        self.rate_limit = RateLimit(self.server)
        self._recorded = source if isinstance(source, RecordedSource) else None
        self._live = source if isinstance(source, LiveSource) else None
        self._pictures = pictures
        self._floor = FloorSeeker()
        self._follower = Follower(FollowConfig())
        self._zone, self._most = Zone(), 0
        self._lock, self._taking = threading.RLock(), threading.Lock()
        self.frame: ViewerFrame | None = None
        self._must_draw = False
        self._stopping = threading.Event()
        self._running = threading.RLock()
        self.server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self.server.scene.set_background_image(np.full((2, 2, 3), (18, 21, 27), np.uint8))
        self._room = None if self._recorded is None else self._recorded.room
        self._scene = Scene(self.server, mesh_of, self._room)
        self._aim_cameras()
        self.server.on_client_connect(self._aim)
        self._make_panel(mesh_of is not None)

    @property
    def port(self) -> int:
        """The port that browsers connect to."""
        return int(self.server.get_port())

    @property
    def tables(self) -> str:
        """The tables of people and nodes in the panel, as Markdown."""
        nodes = "" if self._live is None else str(self._nodes_text.content)
        return f"{self._people_text.content}\n\n{nodes}"

    @property
    def clip_s(self) -> float:
        """Length of the next clip, seconds."""
        least, most = _CLIP_S
        return min(max(float(self._clip_slider.value), least), most)

    @clip_s.setter
    def clip_s(self, seconds: float) -> None:
        self._clip_slider.value = seconds

    def run(self) -> None:
        """Show frames until `stop`."""
        with self._running:
            self._run()

    def _run(self) -> None:
        last, told, is_settled = time.monotonic(), 0.0, True
        while not self._stopping.wait(1.0 / RATE_HZ):
            if not self.rate_limit.is_free():
                continue
            now = time.monotonic()
            frame = self._next(now - last)
            last = now
            if frame is not None and (frame is not self.frame or self._must_draw):
                self._on_loop(self._draw, frame)
                self.rate_limit.sent()
                is_settled = False
            elif not is_settled:
                self._on_loop(self._scene.settle)
                is_settled = True
            if now - told > _TABLE_S:
                told = now
                self._on_loop(self._tell)

    def _on_loop(self, call: Callable[..., None], *arguments: Any) -> None:
        """Call on viser's loop, and wait: another thread's calls fail at times while browsers do not read."""

        async def once() -> None:
            call(*arguments)

        future = asyncio.run_coroutine_threadsafe(once(), self.server.get_event_loop())
        while not future.done():
            wait([future], timeout=_LOOK_S)
            if self._stopping.is_set():
                future.cancel()
        if future.cancelled():
            return
        error = future.exception()
        if isinstance(error, RuntimeError) and "mutated during iteration" in str(error):
            self._must_draw = True  # a frame was drawn in part
        elif error is not None:
            raise error

    def stop(self) -> None:
        """End `run` and the server."""
        self._stopping.set()
        self.rate_limit.stop()
        with self._running:  # until the current frame is drawn
            self.server.stop()

    # Frames

    def _next(self, passed_s: float) -> ViewerFrame | None:
        if self._live is not None:
            return self._live.newest() or (self.frame if self._must_draw else None)
        assert self._recorded is not None
        playback = self._recorded.playback
        if not len(playback):
            return None
        before = playback.index
        playback.advance(passed_s)
        if playback.index < before:
            self._scene.forget_trails()
        return self._recorded.frame(playback.index)

    def _draw(self, frame: ViewerFrame) -> None:
        with self._lock:
            self._must_draw = False
            self.frame = frame
            found = self._floor.add(frame) if self._room is None else None
            if found is not None:
                self._scene.place(found)
                self._aim_cameras()
            self._scene.show(frame, self._shown(frame))
            self.drawn += 1

    def _shown(self, frame: ViewerFrame) -> tuple[Skeleton, ...]:
        """Return the people to draw; live, they are chosen by the nodes."""
        if self._live is not None:
            return self._live.people(frame)
        return chosen(frame.skeletons or (), self._zone, self._most)

    def _aim_cameras(self) -> None:
        """Set the view over the sensor's shoulder into the room."""
        eye, target = self._view()
        camera = self.server.initial_camera
        camera.up, camera.position, camera.look_at = (0.0, 0.0, 1.0), eye, target
        for client in self.server.get_clients().values():
            self._aim(client)

    def _aim(self, client: Any) -> None:
        eye, target = self._view()
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position, client.camera.look_at = eye, target

    def _view(self) -> tuple[Place, Place]:
        """Return the viewpoint and the target."""
        T = self._scene.T_world_camera
        yaw = rotation_z(np.arctan2(T[1, 2], T[0, 2]))
        eye, target = (tuple((T[:3, 3] + yaw @ at).tolist()) for at in (_EYE, _TARGET))
        return eye, target

    # The panel

    def _make_panel(self, with_bodies: bool) -> None:
        gui = self.server.gui
        if self._recorded is not None:
            self._make_player(self._recorded)
        with gui.add_folder("people"):
            self._people_text = gui.add_markdown("*waiting for the first frame*")
        with gui.add_folder("show"):
            for field in fields(Wishes):
                if field.name == "bodies" and not with_bodies:
                    continue
                value = getattr(self._scene.wishes, field.name)
                self._on_change(gui.add_checkbox(_LABELS[field.name], value), self.set_visible, field.name)
        self._make_choices()
        with gui.add_folder("pictures"):
            gui.add_button("screenshot").on_click(partial(self._take, self._take_picture))
            self._clip_slider = gui.add_slider("seconds of a clip", *_CLIP_S, 1, 3)
            gui.add_button("clip").on_click(partial(self._take, self._take_clip))
        if self._live is not None:
            with gui.add_folder("nodes"):
                self._nodes_text = gui.add_markdown(nodes_table(()))

    def _make_player(self, source: RecordedSource) -> None:
        gui, playback = self.server.gui, source.playback
        with gui.add_folder("play"):
            self._time_text = gui.add_markdown("*reading*")
            self._scrub = gui.add_slider("frame", 0, 1, 1, 0)
            play = gui.add_checkbox("playing", True)
            speed = gui.add_dropdown("speed", _SPEEDS, initial_value="1")
            step = gui.add_button_group("step", ("−1", "+1", "start"))
        self._play_box = play

        @self._scrub.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # not our own updates
                with self._lock:
                    playback.seek(int(self._scrub.value))
                    playback.playing = self._play_box.value = False
                    self._scene.forget_trails()

        @play.on_update
        def _(_: Any) -> None:
            playback.playing = bool(play.value)

        @speed.on_update
        def _(_: Any) -> None:
            if speed.value in _SPEEDS:  # anything else was not sent by our page
                playback.speed = float(speed.value)

        @step.on_click
        def _(_: Any) -> None:
            with self._lock:
                if step.value == "start":
                    playback.seek(0)
                else:
                    playback.step(1 if step.value == "+1" else -1)
                    play.value = False

    def _make_choices(self) -> None:
        gui = self.server.gui
        with gui.add_folder("choose"):
            follow = gui.add_dropdown("follow", _FOLLOW, initial_value="first", hint="the person marked ●")
            zone = gui.add_text("zone", "", hint="1:4.5 distances, or -1:1,0.5:3 a box in x and z, metres")
            most = gui.add_slider("nearest", 0, 10, 1, 0, hint="maximum number of people; 0: all")
            self._choice_text = gui.add_markdown("")
        self._on_change(follow, self._take_choice, "follow")
        self._on_change(zone, self._take_choice, "zone")
        self._on_change(most, self._take_choice, "people")

    def _on_change(self, handle: Any, call: Callable[[str, Any], None], name: str) -> None:
        handle.on_update(lambda _: call(name, handle.value))

    def set_visible(self, name: str, value: bool) -> None:
        """Show or hide a part of the scene, by its name in `Wishes`."""
        with self._lock:
            setattr(self._scene.wishes, name, bool(value))
            self._must_draw = True

    def choose(self, name: str, value: str | int) -> str:
        """Choose people: among those of a recording, or by the nodes' parameters.

        Parameters
        ----------
        name : str
            ``follow``, ``zone`` or ``people``.
        value : str or int

        Returns
        -------
        str
            An error text, or an empty one.
        """
        try:
            with self._lock:
                if name == "zone":
                    self._zone = parse_zone(str(value))
                elif name == "people":
                    self._most = int(value)
                else:
                    self._follower = Follower(FollowConfig(whom=str(value)))
                self._must_draw = True
            return "" if self._live is None else self._live.set(name, value)
        except (ConfigError, ValueError) as error:  # including values that our page never sends
            return str(error)

    def _take_choice(self, name: str, value: str | int) -> None:
        self._choice_text.content = self.choose(name, value)

    def _tell(self) -> None:
        """Update the tables."""
        if self._live is not None:
            _set(self._nodes_text, nodes_table(self._live.nodes()))
        if self._recorded is not None:
            self._tell_time(self._recorded)
        frame = self.frame
        if frame is None:
            return
        shown = None if frame.skeletons is None else self._shown(frame)
        followed = self._follower.choose(shown or (), frame.stamp_ns, "").body_id
        _set(self._people_text, people_table(shown, followed, frame.stamp_ns))

    def _tell_time(self, source: RecordedSource) -> None:
        playback = source.playback
        if not len(playback):
            _set(self._time_text, source.error or "*reading*")
            return
        state = "" if playback.is_whole else ", reading on"
        _set(self._time_text, f"{playback.seconds:.2f} s, {len(playback)} frames{state} {source.error}")
        if self._scrub.max != max(1, len(playback) - 1):
            self._scrub.max = max(1, len(playback) - 1)
        if self._scrub.value != playback.index and playback.playing:
            self._scrub.value = playback.index

    # Pictures

    def _take(self, take: Callable[[Any], None], event: Any) -> None:
        """Record a picture or a clip for a browser, one at a time; report failures to it."""
        if event.client is None:
            return
        if not self._taking.acquire(blocking=False):
            _tell_client(event.client, "not taken", "another picture is being taken")
            return
        try:
            take(event)
        except (DepthPoseError, OSError, RuntimeError, TimeoutError) as error:
            # a full disk, a disconnected browser, or one that sends no picture
            _tell_client(event.client, "not taken", " ".join(str(error).split()) or type(error).__name__)
        finally:
            self._taking.release()

    def _take_picture(self, event: Any) -> None:
        width, height = _PICTURE
        picture = event.client.get_render(height, width, transport_format="png", timeout=_RENDER_S)
        path = free_name(self._pictures, ".png")
        save_png(path, picture)
        self._hand_over(event.client, path)

    def _take_clip(self, event: Any) -> None:
        """Record the next seconds: every frame of a recording, or live frames as they arrive."""
        frames = round(self.clip_s * _CLIP_HZ)
        width, height = _PICTURE[0] // 2, _PICTURE[1] // 2
        pictures = []
        playback = self._recorded.playback if self._recorded else None
        was_playing = playback is not None and playback.playing
        started = time.monotonic()
        try:
            for i in range(frames):
                if playback is not None and self._recorded is not None:
                    with self._lock:
                        playback.playing = True
                        playback.advance(1.0 / _CLIP_HZ if i else 0.0)
                        playback.playing = False
                    self._on_loop(self._draw, self._recorded.frame(playback.index))
                pictures.append(
                    event.client.get_render(height, width, transport_format="jpeg", timeout=_RENDER_S)
                )
        finally:
            if playback is not None:
                playback.playing = was_playing
        passed = 1.0 / _CLIP_HZ if playback is not None else (time.monotonic() - started) / frames
        path = free_name(self._pictures, ".gif")
        save_gif(path, pictures, passed)
        self._hand_over(event.client, path)

    def _hand_over(self, client: Any, path: Path) -> None:
        """Print the path of a picture, and send it to the browser, which may be on another machine."""
        client.send_file_download(path.name, path.read_bytes())
        _tell_client(client, "saved", str(path.resolve()))


def _tell_client(client: Any, title: str, body: str) -> None:
    """Notify a browser, unless it has disconnected."""
    with suppress(RuntimeError):
        client.add_notification(title, body, auto_close_seconds=6.0)


def _set(text: Any, content: str) -> None:
    if text.content != content:
        text.content = content
