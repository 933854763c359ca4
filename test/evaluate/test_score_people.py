"""Scores of several people whose errors are known, and the same numbers as the reference scorer's."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from depth_pose.core.errors import InputError
from depth_pose.core.result import Skeleton
from depth_pose.core.rotations import R_CAMERA_FACING_MODEL
from depth_pose.core.skeleton import JOINT_NODES, JOINTS, rest_nodes
from depth_pose.evaluate.score_people import PeopleScore, match_people, score_matches, score_people
from depth_pose.evaluate.truth import KnownPeople, load_known_people, load_truth, tells_of_people
from depth_pose.io.mcap_write import SkeletonWriter
from skeletons import make_skeleton

SHARED_SCORER = Path(__file__).parents[2].parent / "shared" / "tools" / "score_people.py"
REST = (rest_nodes()[JOINT_NODES] * 1.75) @ R_CAMERA_FACING_MODEL + [0, 1.0, 3.0]
FRAMES = 10
STAMPS = 10**18 + 40_000_000 * np.arange(FRAMES)


def make_truth(places: tuple[float, ...] = (-1.0, 1.0)) -> KnownPeople:
    """People who stand beside each other, x metres aside, all of them visible."""
    people = np.array([REST + [x, 0, 0] for x in places]).reshape(-1, 19, 3)
    return KnownPeople(np.tile(people, (FRAMES, 1, 1, 1)), JOINTS, STAMPS, np.ones((FRAMES, len(places))))


def answer(truth: KnownPeople, ids: str = "ab", offset: float = 0.0) -> dict[int, list[Skeleton]]:
    """Everybody where they are, so far beside the truth, in metres."""
    return {
        int(stamp): [
            make_skeleton(p + [offset, 0, 0], stamp_ns=int(stamp), body_id=name)
            for name, p in zip(ids, joints, strict=True)
        ]
        for stamp, joints in zip(truth.stamps_ns, truth.joints, strict=True)
    }


def score(truth: KnownPeople, answers: dict[int, list[Skeleton]]) -> PeopleScore:
    return score_matches([match_people(truth, answers)])


def test_perfect_answers() -> None:
    truth = make_truth()
    result = score(truth, answer(truth))
    assert (result.frames, result.asked, result.found, result.false, result.switches) == (10, 20, 20, 0, 0)
    assert (result.recall, result.precision, result.idf1, result.pck10) == (1, 1, 1, 1)
    assert result.mean_error_mm == 0


@pytest.mark.parametrize(("offset", "found", "pck"), [(0.06, 20, 1.0), (0.11, 20, 0.0), (0.41, 0, 0.0)])
def test_known_offset(offset: float, found: int, pck: float) -> None:
    truth = make_truth()
    result = score(truth, answer(truth, offset=offset))
    assert (result.found, result.pck10) == (found, pck)
    if found:
        assert result.mean_error_mm == pytest.approx(1e3 * offset)
    else:
        assert result.false == 20
        assert np.isnan(result.mean_error_mm)


def test_a_missed_person_and_a_skeleton_on_the_wall() -> None:
    truth = make_truth()
    answers = answer(truth)
    for stamp in STAMPS[:4]:
        del answers[int(stamp)][0]
    answers[int(STAMPS[5])].append(make_skeleton(REST + [0, 0, 2], stamp_ns=int(STAMPS[5]), body_id="wall"))
    result = score(truth, answers)
    assert (result.recall, result.false) == (pytest.approx(0.8), 1)
    assert result.precision == pytest.approx(16 / 17)
    assert result.pck10 == pytest.approx(0.8)
    assert result.idf1 == pytest.approx(2 * 16 / (20 + 17))


def test_exchanged_ids_are_switches() -> None:
    """Two people who take each other's id for the last three frames: two switches, 7 of 10 frames each."""
    truth = make_truth()
    answers = answer(truth)
    for stamp in STAMPS[7:]:
        answers[int(stamp)] = answer(truth, "ba")[int(stamp)]
    result = score(truth, answers)
    assert (result.switches, result.recall) == (2, 1.0)
    assert result.idf1 == pytest.approx(0.7)


def test_who_is_hardly_visible_is_neither_asked_for_nor_a_fault() -> None:
    truth = make_truth()
    truth.visible[:5, 1] = 0.1
    truth.visible[5:, 1] = 0.01
    result = score(truth, answer(truth))
    assert (result.asked, result.found) == (10, 10)
    assert result.false == 5  # the invisible one's: nobody could be seen there


def test_order_of_people_and_late_stamps_do_not_matter() -> None:
    truth = make_truth()
    answers = {stamp + 1_900_000: people[::-1] for stamp, people in answer(truth).items()}
    assert score(truth, answers).recall == 1
    late = {stamp + 2_100_000: people for stamp, people in answer(truth).items()}
    assert score(truth, late).recall == 0


def test_nobody_asked_nobody_answered() -> None:
    truth = make_truth(())
    result = score(truth, {})
    assert (result.asked, result.false) == (0, 0)
    assert np.isnan(result.recall)


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Three sequences with noise, a wall's skeleton, a change of id, a hidden person; one unanswered."""
    truth_dir, predicted_dir = tmp_path / "truth", tmp_path / "predicted"
    truth_dir.mkdir()
    predicted_dir.mkdir()
    for k, name in enumerate("xyz"):
        rng = np.random.default_rng(k)
        truth = make_truth((-1.0, 0.1 * k, 1.0))
        truth.visible[2:4, 1] = 0.15
        truth.visible[4:6, 1] = 0.02
        np.savez(
            truth_dir / f"{name}.npz",
            joints=truth.joints,
            names=np.array(JOINTS),
            stamps_ns=STAMPS,
            visible=truth.visible,
            seen=np.ones((FRAMES, 3, 19), bool),
        )
        if name == "z":
            continue
        with SkeletonWriter(predicted_dir / f"{name}.mcap") as writer:
            for i, stamp in enumerate(STAMPS):
                ids = ("a", "b", "c" if i < 6 else "d")
                noisy = truth.joints[i] + 0.09 * rng.normal(size=(3, 19, 3))
                people = [
                    make_skeleton(p, stamp_ns=int(stamp), body_id=n)
                    for n, p in zip(ids, noisy, strict=True)
                    if n != "b" or i % 3
                ]
                if i == 7:
                    people.append(make_skeleton(REST + [0, 0, 2], stamp_ns=int(stamp), body_id="wall"))
                writer.write_people(people, int(stamp), "optical")
    return truth_dir, predicted_dir


@pytest.mark.skipif(not SHARED_SCORER.exists(), reason="needs ../shared/tools, which is not in the project")
def test_same_numbers_as_the_reference_scorer(folders: tuple[Path, Path]) -> None:
    command = [sys.executable, "-W", "ignore", str(SHARED_SCORER), *map(str, folders)]
    text = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout
    numbers = dict(zip(*[iter(text.splitlines()[-1].split())] * 2, strict=True))
    total = score_people(*folders).total
    assert int(numbers["asked"]) == total.asked
    assert int(numbers["false"]) == total.false > 0
    assert int(numbers["switches"]) == total.switches > 0
    for name, value in (("recall", total.recall), ("precision", total.precision), ("IDF1", total.idf1)):
        assert float(numbers[name]) == pytest.approx(value, abs=5.1e-4), name
    assert float(numbers["mean_error_mm"]) == pytest.approx(total.mean_error_mm, abs=0.051)
    assert float(numbers["within10"]) == pytest.approx(total.pck10, abs=5.1e-5)


def test_files_of_several_people(folders: tuple[Path, Path], tmp_path: Path) -> None:
    truth, predicted = folders
    assert tells_of_people(truth)
    assert tells_of_people(truth / "x.npz")
    one = score_people(truth / "x.npz", predicted / "x.mcap")
    assert list(one.sequences) == ["x"]
    assert one.total == score_people(truth, predicted).sequences["x"]
    with pytest.raises(InputError, match="has 3 people"):
        load_truth(truth / "x.npz")
    fields = dict(np.load(truth / "x.npz"))
    np.savez(tmp_path / "none.npz", **{k: v for k, v in fields.items() if k != "visible"})
    with pytest.raises(InputError, match="must have visible"):
        load_known_people(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", **(fields | {"visible": np.ones((FRAMES, 2))}))
    with pytest.raises(InputError, match="does not fit"):
        load_known_people(tmp_path / "other.npz")
    with pytest.raises(InputError, match="no recording for x"):
        score_people(truth / "x.npz", tmp_path)


def test_a_truth_file_that_names_no_joint_is_refused(tmp_path):
    """Its joints may be declared for any number of people: they take no room."""
    people = 1 << 40
    np.savez(
        tmp_path / "a.npz",
        joints=np.empty((1, people, 0, 3)),
        names=np.zeros(0, "U4"),
        stamps_ns=np.zeros(1, np.int64),
        seen=np.empty((1, people, 0), bool),
    )
    with pytest.raises(InputError, match=r"a\.npz is not a truth file: it names no joint"):
        load_known_people(tmp_path / "a.npz")
