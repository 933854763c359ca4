"""Draw skeletons over depth images as they come: live_plot.py [RECORDING].

Without a recording the frames come from a RealSense camera (realsense.py, beside this file).
"""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import depth_pose

Frame = tuple[float, np.ndarray, depth_pose.Camera]


def recorded(path: Path) -> Iterator[Frame]:
    """Yield time, depth image in metres, and camera of each frame of a recording."""
    for frame in depth_pose.read_recording(path):
        yield frame.stamp_ns * 1e-9, frame.depth, frame.camera


def main(frames: Iterable[Frame], picture: Path | None = None) -> None:
    """Draw every frame until the window is closed; the last one also goes to a file, where it is named."""
    tracker = depth_pose.Tracker()
    figure, axes = plt.subplots()
    image, lines = None, []
    for time, depth, camera in frames:
        people = tracker(depth, camera, time=time)
        if image is None:
            image = axes.imshow(depth, cmap="gray", vmin=0.5, vmax=5.0)
        image.set_data(depth)
        for line in lines:
            line.remove()
        lines = []
        for person in people:
            pixels = camera.project(person.positions)
            for start, end in depth_pose.BONES:
                lines += axes.plot(*pixels[[start, end]].T, color="orange")
        axes.set_title(f"{time:.2f} s: {', '.join(p.id for p in people) or 'nobody'}")
        plt.pause(0.001)
        if not plt.fignum_exists(figure.number):
            break
    if picture is not None:
        figure.savefig(picture)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(recorded(Path(sys.argv[1])))
    else:
        from realsense import frames

        main(frames())
