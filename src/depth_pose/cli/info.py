"""``depth-pose info``: the content of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from depth_pose.cli import shared
from depth_pose.cli.console import print_facts, warn
from depth_pose.cli.damage import be_lenient
from depth_pose.core.errors import InputError
from depth_pose.io.damage import tell_damage
from depth_pose.io.image_options import ImageOptions

if TYPE_CHECKING:
    from depth_pose.io.recording import Recording


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(info)


def info(
    recording: shared.AnyRecording,
    intrinsics: shared.Intrinsics = None,
    depth_scale: shared.DepthScale = None,
    fps: shared.Fps = None,
    lenient: shared.Lenient = False,
) -> None:
    """Print the content of a recording, its depth topic, and whether all of it can be read.

    [bold]Examples:[/bold]

    depth-pose info in.mcap

    depth-pose info rosbag2_folder/
    """
    from depth_pose.io.recording import Recording

    be_lenient(lenient)
    images = ImageOptions.parse(intrinsics, depth_scale, fps)
    found = Recording(recording, images)
    read = dict.fromkeys(found.topics, 0)
    times = []
    for message in found.messages(*found.topics):
        read[message.topic] += 1
        times.append(message.log_time_ns)
    rows = [
        (topic.name, f"{read[topic.name]} messages, {topic.kind}")
        for topic in sorted(found.topics.values(), key=lambda topic: topic.name)
    ]
    rows += [(name, f"cannot be read: {why}") for name, why in sorted(found.others.items())]
    rows.append(("length", f"{(max(times) - min(times)) / 1e9:.2f} s" if times else "no messages"))
    print_facts(str(recording), [*rows, *_depth(found, images)])
    tell_damage(found.damage)


def _depth(recording: Recording, images: ImageOptions) -> list[tuple[str, str]]:
    """Describe the depth frames of a recording by the first one."""
    from depth_pose.io.mcap_read import DepthReader

    try:
        reader = DepthReader(recording.path, images=images, tell=False)
        frame = next(iter(reader))
    except InputError as error:
        warn([str(error)])
        return []
    warn(line for line in reader.warnings if line not in reader.damage)
    camera = frame.camera
    return [
        ("depth", reader.topic.name),
        ("image", f"{camera.width} x {camera.height}, frame {frame.frame_id!r}"),
        ("camera", f"fx {camera.fx:.2f}, fy {camera.fy:.2f}, cx {camera.cx:.2f}, cy {camera.cy:.2f} pixels"),
    ]
