"""``depth-pose view``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from depth_pose.cli import shared
from depth_pose.cli.console import console, loading
from depth_pose.core.extras import require
from depth_pose.core.printable import printable
from depth_pose.io.schemas import PEOPLE_TOPIC

if TYPE_CHECKING:
    from depth_pose.viewer.app import MeshOf
    from depth_pose.viewer.source import RecordedSource


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(view)


def view(
    recording: Annotated[
        Path | None,
        typer.Argument(
            help="Depth recording, in any format that `run` reads; or a room's skeletons alone.",
            show_default="the running nodes",
        ),
    ] = None,
    skeletons: Annotated[
        Path | None,
        typer.Argument(help="Recording of its skeletons.", show_default="they are computed while it plays"),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port for the browser; 0: any.")] = 8080,
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 admits other machines.")
    ] = "127.0.0.1",
    pictures: Annotated[Path, typer.Option(help="Folder of screenshots and clips.")] = Path("results"),
    points: Annotated[
        int, typer.Option(min=100, max=1_000_000, help="Maximum number of points shown.")
    ] = 20_000,
    bank: Annotated[
        Path | None, typer.Option(help="Exemplar bank with the body to show.", show_default="the set-up's")
    ] = None,
    depth_topic: Annotated[
        str | None,
        typer.Option(
            help="Depth images or point cloud.", show_default="the only one; live: the denoise node's"
        ),
    ] = None,
    topic: Annotated[str, typer.Option(help="The skeletons' topic in their recording.")] = PEOPLE_TOPIC,
    rig: shared.RigFile = None,
    camera: shared.RigCameraName = None,
) -> None:
    """Show people and depth in a browser: of the running nodes, or of a recording.

    Prints an address; open it in any browser on this machine. For a recording, the panel has play, pause,
    position and speed; live, it shows the nodes' state, and follow, zone and nearest set their parameters.
    Without SKELETONS the recording's people are found while it is shown; nothing is saved.

    Skeletons of `run --rig` are shown in their room, alone or with the depth of one camera; --rig gives the
    cameras' poses.

    Other machines cannot connect unless --host admits them; there is no password.

    [bold]Examples:[/bold]

    depth-pose view

    depth-pose view in.mcap out.mcap

    depth-pose view in.mcap

    depth-pose view in.mcap out.mcap --host 0.0.0.0 --port 9000

    depth-pose view room.mcap

    depth-pose view A.mcap room.mcap --rig rig.yaml
    """
    from depth_pose.viewer.app import Viewer
    from depth_pose.viewer.source import LiveSource

    require("viser", "the viewer")
    source: LiveSource | RecordedSource
    if recording is None:
        from depth_pose.cli.live import call_ros

        watch = call_ros("tools.watch", "start_watch", depth_topic)
        source, stop = LiveSource(watch, points), watch.stop
    else:
        source = recorded_source(recording, skeletons, bank, depth_topic, topic, points, rig, camera)
        source.start()
        stop = source.stop
    viewer = None
    try:
        viewer = Viewer(source, host=host, port=port, pictures=pictures, mesh_of=_bodies(bank))
        print_address(host, viewer.port)
        viewer.run()
    except KeyboardInterrupt:
        pass
    finally:
        if viewer is not None:
            viewer.stop()
        stop()


def recorded_source(
    recording: Path,
    skeletons: Path | None,
    bank: Path | None,
    depth_topic: str | None,
    topic: str,
    points: int,
    rig: Path | None = None,
    camera: str | None = None,
) -> RecordedSource:
    """Return the frames of a recording with skeletons read from a file, or found while it is shown.

    Frames of a recording of a room's skeletons have no depth.
    """
    from depth_pose.io.mcap_read import DepthReader
    from depth_pose.rooms.placed_camera import answers_in_frames
    from depth_pose.rooms.recorded import has_room, read_recorded
    from depth_pose.rooms.rigfile import load_rig
    from depth_pose.viewer.known_room import KnownRoom, level_sensor
    from depth_pose.viewer.source import RecordedSource, source_without_depth

    is_room = skeletons is None and has_room(recording, topic)
    if is_room and camera is None and rig is not None:
        camera = "0"  # the first
    placed = shared.placed_camera(rig, camera, recording)
    room = None
    if rig is not None and placed is not None:
        room = KnownRoom(placed.T_room_camera, load_rig(rig).cameras)
    if is_room:
        return source_without_depth(read_recorded(recording, topic), room or KnownRoom(level_sensor()))
    reader = DepthReader(recording, depth_topic)
    if skeletons is not None:
        answer = answers_in_frames(read_recorded(skeletons, topic), placed)
        return RecordedSource(reader, answer, points, room)
    from depth_pose.bank import Bank, default_bank_path
    from depth_pose.pipeline import PosePipeline

    bank = bank or default_bank_path()
    with loading("the bank"):
        pipeline = PosePipeline(Bank.load(bank))
        pipeline.warm_up()
    return RecordedSource(reader, lambda frame: pipeline.process_frame(frame).skeletons, points, room)


def _bodies(bank: Path | None) -> MeshOf:
    """Return the maker of fitted bodies."""
    from depth_pose.bank import default_bank_path
    from depth_pose.viewer.bodies import BodyMaker

    return BodyMaker(bank or default_bank_path())


def print_address(host: str, port: int) -> None:
    """Print the viewer's address, with a warning if other machines can reach it."""
    from depth_pose.viewer.access import LOOPBACK

    shown = "localhost" if host in (*LOOPBACK, "0.0.0.0", "::") else host
    console.print(f"open http://{escape(printable(shown))}:{port} in a browser; Ctrl-C ends", highlight=False)
    if host not in LOOPBACK:
        console.print(
            f"[yellow]note:[/yellow] {escape(printable(host))} is open to other machines; anyone who reaches "
            f"port {port} sees the room and can change what is shown, without a password",
            highlight=False,
            soft_wrap=True,
        )
