"""Contact sheet of an archive: one frame of each recording, with its skeletons."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from depth_pose.archive.inputs import Source
from depth_pose.archive.process import output_of
from depth_pose.evaluate.overlay import draw_sheet
from depth_pose.evaluate.panels import NOBODY, Panel
from depth_pose.io.image_options import ImageOptions
from depth_pose.io.mcap_read import DepthReader
from depth_pose.io.skeleton_read import read_people

SHEET = "sheet.png"
"""Name of the picture."""

_MOST_PANELS = 24
"""Maximum number of recordings on the picture, for readability."""
_LOOK_AT = 200
"""Number of frames from which the one to show is chosen; reading more would take too long."""


def save_archive_sheet(
    sources: Sequence[Source],
    folder: Path,
    path: Path,
    depth_topic: str | None = None,
    images: ImageOptions | None = None,
) -> int:
    """Draw one frame of each of at most 24 recordings, evenly spread over those with skeletons.

    Shows the middle one of the frames with the most people, among the first 200 frames with skeletons.

    Parameters
    ----------
    sources : sequence of Source
        Recordings with finished skeletons.
    folder : Path
        Where their skeletons are.
    path : Path
        The picture.
    depth_topic : str, optional
        The depth topic.
    images : ImageOptions, optional
        Camera and scale of folders of images.

    Returns
    -------
    int
        Number of recordings shown; 0, and no picture, if no person is in view anywhere.

    Raises
    ------
    InputError
        Where a recording, or its skeletons, cannot be read.
    """
    count = min(len(sources), _MOST_PANELS)
    chosen = [sources[k * len(sources) // count] for k in range(count)]
    panels = [p for p in (_panel(source, folder, depth_topic, images) for source in chosen) if p is not None]
    if panels:
        draw_sheet(panels, path, f"{len(panels)} of {len(sources)} recordings")
    return len(panels)


def _panel(
    source: Source, folder: Path, depth_topic: str | None, images: ImageOptions | None
) -> Panel | None:
    answers = list(islice(read_people(output_of(source, folder)), _LOOK_AT))
    most = max((len(a.skeletons) for a in answers), default=0)
    if most == 0:
        return None
    best = [a for a in answers if len(a.skeletons) == most]
    answer = best[len(best) // 2]
    for frame in DepthReader(source.path, depth_topic, images, tell=False):
        if frame.stamp_ns == answer.stamp_ns:
            seconds = (frame.stamp_ns - answers[0].stamp_ns) * 1e-9
            return Panel(frame, tuple(answer.skeletons), NOBODY, seconds, source.name)
    return None
