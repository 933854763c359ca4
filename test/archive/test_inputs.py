"""Which recordings are meant."""

from __future__ import annotations

import numpy as np
import pytest

from depth_pose.archive.inputs import find_sources, is_one_recording
from depth_pose.core.camera import Camera
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.io.mcap_write import DepthWriter

CAMERA = Camera(8, 6, 8.0, 8.0, 3.5, 2.5)
S = 1_000_000_000


def record(path, start_s, end_s, topic="/camera/depth/image_raw"):
    with DepthWriter(path, CAMERA, "optical", topic) as writer:
        for stamp in (start_s, end_s):
            writer.write(int(stamp * S), np.ones((6, 8), np.float32))
    return path


@pytest.fixture
def archive(tmp_path):
    """Clips that begin at the same time, a folder with more, and a recording that is split."""
    root = tmp_path / "archive"
    for name in ("a", "b", "ward/clip_1", "ward/clip_2"):
        record(root / f"{name}.mcap", 1, 5)
    record(root / "split" / "split_0.mcap", 1, 5)
    record(root / "split" / "split_1.mcap", 5.1, 9)
    return root


def names(sources):
    return [source.name for source in sources]


def test_folders_are_looked_through(archive):
    found = find_sources([archive])
    assert names(found) == ["a", "b", "split", "ward/clip_1", "ward/clip_2"]
    assert found[2].path == archive / "split"
    assert found[2].size == sum(p.stat().st_size for p in (archive / "split").iterdir())


def test_the_output_is_not_looked_into(archive):
    record(archive / "out" / "a.mcap", 1, 5)
    assert "out/a" not in names(find_sources([archive], archive / "out"))
    assert "out/a" not in names(find_sources([f"{archive}/**/*.mcap"], archive / "out"))


def test_the_output_is_said_not_to_be_looked_into(archive):
    day = archive / "ward"
    for given in (day, f"{day}/*.mcap", f"{archive}/w*"):
        with pytest.raises(
            InputError, match=r"ward, which is the output's folder and never read: name another"
        ):
            find_sources([given], day)
    with pytest.raises(InputError) as elsewhere:
        find_sources([f"{day}/nothing*"], archive / "out")
    assert "output's" not in str(elsewhere.value)


@pytest.mark.parametrize(
    ("pattern", "expected"),
    [
        ("*.mcap", ["a", "b"]),
        ("ward/clip_[2-9].mcap", ["clip_2"]),
        ("*/clip_*.mcap", ["ward/clip_1", "ward/clip_2"]),
        ("[sw]*", ["split", "ward/clip_1", "ward/clip_2"]),
    ],
)
def test_patterns(archive, pattern, expected):
    assert names(find_sources([f"{archive}/{pattern}"])) == expected


def test_each_once_in_the_order_given(archive):
    found = find_sources([archive / "b.mcap", f"{archive}/*.mcap"])
    assert names(found) == ["b", "a"]


def test_same_names_are_told_apart_by_their_folders(archive):
    for night in ("monday", "tuesday"):
        record(archive / night / "depth.mcap", 1, 5)
    files = [archive / night / "depth.mcap" for night in ("monday", "tuesday")]
    assert names(find_sources(files)) == ["monday/depth", "tuesday/depth"]


def test_names_that_cannot_be_told_apart(tmp_path):
    record(tmp_path / "x" / "a.mcap", 1, 5)
    (tmp_path / "x" / "a.MCAP").write_bytes((tmp_path / "x" / "a.mcap").read_bytes())
    with pytest.raises(ConfigError, match="have the same name"):
        find_sources([tmp_path / "x" / "a.mcap", tmp_path / "x" / "a.MCAP"])


@pytest.mark.parametrize(
    ("second", "start", "topic", "one"),
    [
        ("night_1.mcap", 5.03, "/camera/depth/image_raw", True),
        ("night_1.mcap", 1.0, "/camera/depth/image_raw", False),  # at the same time
        ("night_1.mcap", 7.0, "/camera/depth/image_raw", False),  # two seconds later
        ("day_1.mcap", 5.03, "/camera/depth/image_raw", False),
        ("night_1.mcap", 5.03, "/other/depth/image_raw", False),
    ],
)
def test_parts_of_one_recording_carry_on(tmp_path, second, start, topic, one):
    record(tmp_path / "night_0.mcap", 1, 5)
    record(tmp_path / second, start, 9, topic)
    assert is_one_recording(tmp_path) == one
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    assert is_one_recording(tmp_path)


def test_a_folder_of_one_file(tmp_path):
    """It is a folder of recordings, as with two files; the recording goes by the file's name."""
    record(tmp_path / "ward" / "a.mcap", 1, 5)
    (tmp_path / "ward" / "pictures").mkdir()
    assert not is_one_recording(tmp_path / "ward")
    assert names(find_sources([tmp_path / "ward"])) == ["a"]
    assert names(find_sources([tmp_path])) == ["ward/a"]


def test_parts_given_one_by_one_are_one_recording(archive):
    (archive / "split" / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    parts = sorted((archive / "split").glob("*.mcap"))
    found = find_sources([*parts, archive / "a.mcap"])
    assert names(found) == ["split", "a"]
    assert found[0].path == archive / "split"
    assert names(find_sources([parts[0], archive / "a.mcap"])) == ["split_0", "a"]


def test_nothing_there(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        find_sources([tmp_path / "none.mcap"])
    with pytest.raises(InputError, match=r"no recording \(\.mcap, \.db3, \.bag.*\) in"):
        find_sources([tmp_path])


def test_other_formats_and_folders_of_images(tmp_path):
    for name in ("a.db3", "b.bag", "c.txt"):
        (tmp_path / name).write_bytes(b"1")
    for name in ("with", "without"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "1.png").write_bytes(b"1")
    (tmp_path / "with/camera.json").write_text("{}")
    assert names(find_sources([tmp_path])) == ["a", "b", "with"]
    assert names(find_sources([tmp_path / "without"])) == ["without"]
    assert is_one_recording(tmp_path / "without") and not is_one_recording(tmp_path)
    (tmp_path / "without/x.bag").write_bytes(b"1")
    assert names(find_sources([tmp_path / "without"])) == ["x"]


def test_pipes_are_refused_at_once(tmp_path):
    import os

    from depth_pose.archive.jobs import content_hash

    for name in ("a_1.mcap", "a_2.mcap"):
        os.mkfifo(tmp_path / name)
    assert names(find_sources([tmp_path])) == ["a_1", "a_2"]
    with pytest.raises(InputError, match="a pipe, a device"):
        content_hash(tmp_path / "a_1.mcap")


def test_another_camera_is_another_recording(tmp_path):
    from depth_pose.archive.jobs import content_hash

    (tmp_path / "1.png").write_bytes(b"1")
    hashes = {content_hash(tmp_path)}
    for text in ("{}", '{"fx": 1}'):
        (tmp_path / "camera.json").write_text(text)
        hashes.add(content_hash(tmp_path))
    assert len(hashes) == 3


def test_all_that_is_read_is_in_the_hash(tmp_path):
    """Names of images, which are their stamps and their order; a database's log; a folder's metadata."""
    from depth_pose.archive.jobs import content_hash

    images = tmp_path / "images"
    images.mkdir()
    (images / "1.5.png").write_bytes(b"1")
    (images / "2.5.png").write_bytes(b"2")
    seen = {content_hash(images)}
    (images / "2.5.png").rename(images / "2.6.png")
    seen.add(content_hash(images))
    assert len(seen) == 2
    database = tmp_path / "bag" / "a.db3"
    database.parent.mkdir()
    database.write_bytes(b"SQLite format 3\0")
    for place in (database, database.parent):
        seen = {content_hash(place)}
        for name in ("a.db3-wal", *(["metadata.yaml"] if place.is_dir() else [])):
            (database.parent / name).write_bytes(b"new")
            seen.add(content_hash(place))
        assert len(seen) == 2 + place.is_dir()
        (database.parent / "a.db3-wal").unlink()
    renamed = database.rename(tmp_path / "bag" / "b.db3")
    before = content_hash(renamed)
    assert before == content_hash(renamed.rename(database))


def test_an_output_inside_the_recording_changes_nothing(tmp_path):
    """The same command again goes on where it was stopped: what it made is no recording of the folder."""
    for number, start in ((0, 1), (1, 5.1)):
        record(tmp_path / "parts" / f"night_{number}.mcap", start, start + 4)
    (tmp_path / "images").mkdir()
    (tmp_path / "images/1.png").write_bytes(b"1")
    for folder in ("parts", "images"):
        out = tmp_path / folder / "skeletons"
        for _ in range(2):
            assert names(find_sources([tmp_path / folder], out)) == [folder]
            record(out / f"{folder}.mcap", 1, 5)
    with pytest.raises(InputError, match="output's folder"):
        find_sources([tmp_path / "images"], tmp_path / "images")


def test_inputs_may_overlap(archive, monkeypatch):
    monkeypatch.chdir(archive)
    assert names(find_sources(["*.mcap", "a*.mcap", str(archive / "a.mcap"), "ward"])) == [
        *("a", "b"),
        *("clip_1", "clip_2"),
    ]


def test_a_folder_with_a_recording_s_name_is_looked_into(tmp_path):
    record(tmp_path / "day.mcap" / "one.mcap", 1, 5)
    assert names(find_sources([tmp_path])) == ["day.mcap/one"]
