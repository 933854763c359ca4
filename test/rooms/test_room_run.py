"""The recordings of two cameras in one room, run to one: as users do."""

import shutil
import sys

import numpy as np
import pytest

from depth_pose.cli import main
from depth_pose.evaluate.score_people import match_people, score_matches
from depth_pose.evaluate.truth import KnownPeople
from depth_pose.io.skeleton_read import read_people
from depth_pose.rooms.rigfile import load_rig, save_rig


def call(*arguments):
    """Call the command in this process; return its exit code."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["depth-pose", *map(str, arguments)])
        patch.setenv("COLUMNS", "200")
        try:
            main()
        except SystemExit as ended:
            return ended.code or 0
    return 0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two people before two cameras, 240 pixels wide, for a second; with the true rig and joints."""
    folder = tmp_path_factory.mktemp("room")
    how = ["--room", "--people", "2", "--cameras", "2", "--seconds", "1", "--width", "240", "--seed", "1"]
    assert call("simulate", *how, "-o", folder / "room.mcap") == 0
    return folder


def run(folder, output, bank_path, *more, rig="room.yaml", names=("room_0.mcap", "room_1.mcap")):
    paths = [folder / name for name in names]
    return call("run", "--rig", folder / rig, *paths, "-o", output, "--bank", bank_path, *more)


@pytest.fixture(scope="module")
def room(folder, bank_path):
    output = folder / "skeletons.mcap"
    assert run(folder, output, bank_path, "--workers", "0") == 0
    return output


def test_everybody_is_found_once_in_the_frame_of_the_room(folder, room):
    truth = np.load(folder / "room.npz")
    answers = {m.stamp_ns: m.skeletons for m in read_people(room)}
    assert {s.frame_id for everybody in answers.values() for s in everybody} == {"room"}
    known = KnownPeople(truth["joints"], tuple(truth["names"]), truth["stamps_ns"], truth["visible"])
    score = score_matches([match_people(known, answers)])
    assert score.recall > 0.9 and score.false <= 2 and score.idf1 > 0.9
    assert score.mean_error_mm < 150.0  # a small bank, and the first second


def test_the_same_with_any_number_of_workers(folder, room, bank_path, tmp_path):
    assert run(folder, tmp_path / "again.mcap", bank_path, "--workers", "2") == 0
    assert (tmp_path / "again.mcap").read_bytes() == room.read_bytes()


def refused(capfd, *arguments, **options):
    assert run(*arguments, **options) in (1, 2)
    return " ".join(capfd.readouterr().err.split())


def test_recordings_that_do_not_fit_the_rig_are_refused(folder, bank_path, tmp_path, capfd):
    out = tmp_path / "out.mcap"
    assert "2 cameras (" in refused(capfd, folder, out, bank_path, names=["room_0.mcap"])
    twice = refused(capfd, folder, out, bank_path, names=["room_0.mcap", "room_0.mcap"])
    assert "the same recording is given twice" in twice
    assert "--passes does not go with --rig" in refused(capfd, folder, out, bank_path, "--passes", "2")
    swapped = refused(capfd, folder, out, bank_path, "--workers", "0", names=["room_1.mcap", "room_0.mcap"])
    assert "in the rig they are" in swapped
    assert not out.exists()


def test_recordings_of_different_times_are_refused(folder, bank_path, tmp_path, capfd):
    for name in ("room_0.mcap", "room_1.mcap"):
        shutil.copy(folder / name, tmp_path / name)
    rig = load_rig(folder / "room.yaml")
    save_rig(tmp_path / "room.yaml", rig.cameras, rig.topics, rig.up, (0.0, 100.0), rig.frame_ids)
    said = refused(capfd, tmp_path, tmp_path / "out.mcap", bank_path, "--workers", "0")
    assert "recordings of one room overlap in time" in said and "clock_offset" in said
