"""Rows are written while the skeletons are read: as of the whole recording, in the memory of a part."""

from __future__ import annotations

import io
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from depth_pose.core.errors import InputError
from depth_pose.export import export_skeletons
from depth_pose.export.as_read import PART_FRAMES
from depth_pose.export.tables import write_angles, write_csv, write_json
from depth_pose.export.tracks import chosen, read_tracks
from depth_pose.io.mcap_write import SkeletonWriter
from skeletons import random_skeleton

STEP_NS = 33_333_333
FRAMES = 2 * PART_FRAMES + 7


def write(path, numbers, people_of):
    """Frames with these numbers, in this order; ``people_of`` gives the ids in one."""
    rng = np.random.default_rng(0)
    known = [random_skeleton(rng) for _ in range(8)]
    with SkeletonWriter(path) as writer:
        for i in numbers:
            stamp = 10**18 + i * STEP_NS
            people = [
                replace(known[(i + k) % 8], body_id=who, stamp_ns=stamp) for k, who in enumerate(people_of(i))
            ]
            writer.write_people(people, stamp, "optical")
    return path


def two(i):
    """A person who comes and goes over the parts' ends, and one who is there from the second part on."""
    return [who for who, is_there in (("a", i % 100 < 60), ("b", i > PART_FRAMES + 5)) if is_there]


def whole_text(path, kind, angles=False, people=()):
    tracks, stream = chosen(read_tracks(path), people, path), io.StringIO(newline="")
    if kind == ".json":
        write_json(stream, [tracks], tracks.frame_id, None)
    elif angles:
        write_angles(stream, [tracks], None)
    else:
        write_csv(stream, [tracks])
    return stream.getvalue()


@pytest.mark.parametrize(
    ("kind", "angles", "people"), [(".csv", False, ()), (".csv", True, ("b",)), (".json", False, ())]
)
def test_parts_give_the_file_of_the_whole(tmp_path, kind, angles, people):
    path = write(tmp_path / "in.mcap", range(FRAMES), two)
    (file,) = export_skeletons(path, tmp_path / f"out{kind}", angles=angles, people=people).files
    assert file.path.read_bytes().decode() == whole_text(path, kind, angles, people)
    tracks = chosen(read_tracks(path), people, path)
    assert file.frames == FRAMES
    for found, expected in zip(file.tracks, tracks.people, strict=True):
        assert (found.body_id, found.frame_id) == (expected.body_id, expected.frame_id)
        np.testing.assert_array_equal(found.stamps_ns, expected.stamps_ns)
        np.testing.assert_array_equal(found.present, expected.present)


def test_frames_out_of_order_are_sorted_as_before(tmp_path):
    numbers = [*range(1, FRAMES), 0]
    path = write(tmp_path / "in.mcap", numbers, two)
    export_skeletons(path, tmp_path / "out.csv")
    written = (tmp_path / "out.csv").read_bytes().decode()
    assert written == whole_text(path, ".csv")
    assert written.splitlines()[1].startswith("0,1000000000000000000,")


def test_somebody_who_is_missing_leaves_no_file(tmp_path):
    path = write(tmp_path / "in.mcap", range(FRAMES), two)
    with pytest.raises(InputError, match="nobody with the id c; it has a, b"):
        export_skeletons(path, tmp_path / "out.csv", people=["c"])
    nobody = write(tmp_path / "nobody.mcap", range(FRAMES), lambda i: [])
    with pytest.raises(InputError, match=f"shows nobody in {FRAMES} frames"):
        export_skeletons(nobody, tmp_path / "out.csv")
    assert [file.name for file in tmp_path.iterdir() if file.suffix != ".mcap"] == []


def test_memory_does_not_grow_with_the_recording(tmp_path):
    peaks = []
    for parts in (2, 6):
        path = write(tmp_path / f"{parts}.mcap", range(parts * PART_FRAMES), lambda i: ["a", "b"])
        export_skeletons(path, tmp_path / "warm.csv", angles=True)
        tracemalloc.start()
        export_skeletons(path, tmp_path / "out.csv", angles=True)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0], peaks
