import matplotlib.image
import numpy as np
import pytest

import synthetic as syn
from depth_pose.core.errors import InputError
from depth_pose.evaluate.bank_check import match_frames, save_check
from depth_pose.io.mcap_write import DepthWriter


@pytest.fixture(scope="module")
def recording(body, tmp_path_factory):
    """Six frames of one exemplar's body, then nobody for four."""
    path = tmp_path_factory.mktemp("check") / "clip.mcap"
    with DepthWriter(path, syn.CAMERA, "optical") as writer:
        for i in range(10):
            person = syn.posed(syn.arms_down(), turn=2.0 * i)
            meshes = [syn.mesh(person)] if i < 6 else []
            depth = np.minimum(syn.draw(*meshes), syn.room())
            frame = syn.to_frame(depth, syn.START_NS + i * syn.STEP_NS)
            writer.write(frame.stamp_ns, frame.depth)
    return path


def test_inputs_beside_their_matches(bank, recording, tmp_path):
    told = []
    matched = match_frames(bank, recording, frames=2, candidates=3, progress=told.append)
    assert told == [1, 2]
    first, last = matched.frames
    assert (first.number, last.number) == (2, 7)
    (match,) = first.matches
    assert 1 <= len(match.candidates) <= 3
    assert match.scale == pytest.approx(1.0, abs=0.08)
    assert match.candidates[0].score < 0.6
    assert last.matches == ()
    lines = list(matched.lines())
    assert lines[0].startswith("frame 2: scale ")
    assert lines[1] == "frame 7: nobody in view"
    save_check(matched, bank, tmp_path / "new" / "check.png", "clip")
    picture = matplotlib.image.imread(tmp_path / "new" / "check.png")[..., :3]
    height, width = picture.shape[:2]
    row = picture[height // 20 : height // 2]
    for k in range(1 + len(match.candidates)):  # the input and each match show a body
        panel = row[:, k * width // 4 : (k + 1) * width // 4]
        assert (panel.max(axis=-1) > 0.35).mean() > 0.03


def test_recording_without_frames(bank, tmp_path):
    path = tmp_path / "empty.mcap"
    with DepthWriter(path, syn.CAMERA, "optical"):
        pass
    with pytest.raises(InputError, match=r"empty\.mcap"):
        match_frames(bank, path, 2, 3)
