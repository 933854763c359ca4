"""Files that are read: what they declare is looked at before anything is allocated."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from depth_pose.bank.sources import gather_poses
from depth_pose.core.arrays import DamagedArrays, array_names, load_arrays
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.core.reading import (
    MOST_SETTINGS_BYTES,
    MOST_VALUES,
    parse_json,
    parse_long_yaml,
    parse_yaml,
    read_text,
)
from depth_pose.io.recording import Recording
from depth_pose.motion.bvh import read_bvh
from depth_pose.sim.motion import load_motion
from little_memory import little_memory, yaml_bombs
from motion_writers import write_bvh


def _bomb(path: Path, shape: str, zeros: int) -> Path:
    """Write an ``.npz`` file whose array has a header of one's own, and so many zeros behind it."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive,
        archive.open("joints.npy", "w", force_zip64=True) as stream,
    ):
        stream.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
        block = bytes(1 << 20)
        for _ in range(zeros >> 20):
            stream.write(block)
    return path


def test_arrays_come_back(tmp_path: Path) -> None:
    arrays = {"a": np.arange(6.0).reshape(2, 3), "names": np.array(["x", "yy"]), "none": np.zeros((0, 3))}
    arrays |= {"fortran": np.asfortranarray(arrays["a"]), "flag": np.array(True), "half": np.float16([1, 2])}
    for write in (np.savez, np.savez_compressed):
        write(tmp_path / "a.npz", **arrays)
        found = load_arrays(tmp_path / "a.npz")
        assert found.keys() == arrays.keys() == array_names(tmp_path / "a.npz")
        for name, array in arrays.items():
            assert found[name].dtype == array.dtype
            assert np.array_equal(found[name], array)
        assert load_arrays(tmp_path / "a.npz", ("a", "b")).keys() == {"a"}


def test_much_that_is_honest_is_read(tmp_path: Path) -> None:
    """30 MB that compress to a tenth of it: more than all but banks have."""
    big = np.tile(np.random.default_rng(0).normal(size=4000), 1000)
    np.savez_compressed(tmp_path / "a.npz", big=big)
    assert np.array_equal(load_arrays(tmp_path / "a.npz")["big"], big)


def test_bombs_are_refused_without_memory(tmp_path: Path) -> None:
    zeros = _bomb(tmp_path / "zeros.npz", f"({(768 << 20) // 8},)", 768 << 20)
    assert zeros.stat().st_size < 2 << 20
    claims = _bomb(tmp_path / "claims.npz", "(662500000,)", 0)  # 5.3 GB that are not there
    more = _bomb(tmp_path / "more.npz", "(4,)", 768 << 20)
    odd = [_bomb(tmp_path / f"{k}.npz", shape, 0) for k, shape in enumerate(("(-1,)", "(2**70,)", "(1,)*70"))]
    for path in (zeros, claims, more, *odd):
        with little_memory(), pytest.raises(DamagedArrays):
            load_arrays(path)
    with pytest.raises(DamagedArrays, match=r"declared as 805 MB; at most 268 MB fit it"):
        load_arrays(zeros)


def test_archives_that_are_none(tmp_path: Path) -> None:
    np.savez(tmp_path / "objects.npz", a=np.array([{}], dtype=object))
    np.savez(tmp_path / "records.npz", a=np.zeros(2, dtype=[("x", "f4")]))
    (tmp_path / "text.npz").write_text("hello")
    (tmp_path / "empty.npz").write_bytes(b"")
    with zipfile.ZipFile(tmp_path / "twice.npz", "w") as archive:
        stream = io.BytesIO()
        np.save(stream, np.zeros(2))
        with pytest.warns(UserWarning, match="Duplicate"):
            archive.writestr("a.npy", stream.getvalue())
            archive.writestr("a.npy", stream.getvalue())
    with zipfile.ZipFile(tmp_path / "many.npz", "w") as archive:
        for i in range(1200):
            archive.writestr(f"{i}.npy", stream.getvalue())
    os.mkfifo(tmp_path / "pipe.npz")
    names = ("objects", "records", "text", "empty", "twice", "many", "pipe", "missing")
    for path in [tmp_path / f"{name}.npz" for name in names] + [tmp_path, Path("/dev/zero")]:
        with pytest.raises(DamagedArrays):
            load_arrays(path)


def test_text_is_utf8_and_of_ordinary_files(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(b"a: \xff")
    with pytest.raises(InputError, match=r"a\.yaml is not UTF-8 text: invalid start byte at byte 3"):
        read_text(path)
    path.write_bytes(b"\xef\xbb\xbfa: 1")  # as Windows writes it
    assert read_text(path) == "a: 1"
    path.write_bytes(bytes(MOST_SETTINGS_BYTES + 1))
    with pytest.raises(InputError, match=r"it has 1\.0 MB; at most 1\.0 MB are read"):
        read_text(path)
    os.mkfifo(tmp_path / "pipe")
    for odd in (tmp_path, tmp_path / "pipe", Path("/dev/zero"), tmp_path / "none", "a\0b"):
        with pytest.raises(InputError, match="cannot be read"):
            read_text(odd)


def test_yaml_is_bounded(tmp_path: Path) -> None:
    assert parse_yaml("f", "a: &x [1, 2]\nb: *x\nc: {<<: &y {d: 1}}\n") == {
        "a": [1, 2],
        "b": [1, 2],
        "c": {"d": 1},
    }
    for text in (*yaml_bombs(), "- 1\n" * (MOST_VALUES + 1)):
        with little_memory(), pytest.raises(ConfigError, match=f"it holds over {MOST_VALUES} values"):
            parse_yaml("f", text)
    odd = ("a: &x [*x]", "[" * 5000, "a: 2001-99-99", "? [a]\n: 1", "a: !!python/name:os.system",
           "a: " + "1" * 5000, "a: !!int ''", "a: [", "\x00")  # fmt: skip
    for text in odd:
        with pytest.raises(ConfigError, match=r"^f is not YAML: ") as refused:
            parse_yaml("f", text)
        assert "\n" not in str(refused.value)


def test_yaml_of_recordings_is_bounded(tmp_path: Path) -> None:
    """Lists may be long where programs write them; aliases count."""
    assert len(parse_long_yaml("f", "- 1\n" * (MOST_VALUES + 1))) == MOST_VALUES + 1
    assert parse_long_yaml("f", "a: &x [1, 2]\nb: *x\n")["b"] == [1, 2]
    with pytest.raises(ConfigError, match="nesting"):  # PyYAML 6.0.4 says it itself
        parse_long_yaml("f", "[" * 400_000 + "]" * 400_000)  # minutes, were it read
    told = "rosbag2_bagfile_information: {relative_file_paths: *a29, topics_with_message_count: []}\n"
    for bomb in yaml_bombs():
        (tmp_path / "metadata.yaml").write_text(bomb + told)
        with (
            little_memory(),
            pytest.raises(InputError, match=rf"it holds over {MOST_VALUES} values.*reindex"),
        ):
            Recording(tmp_path)


def test_json_is_bounded() -> None:
    for text in ("[" * 100_000, "1" * 5000, "{", "\x00"):
        with pytest.raises(ConfigError, match=r"^f is not JSON: "):
            parse_json("f", text)


def test_motion_of_forty_million_frames_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    path.write_text("HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\n}\nMOTION\nFrames: 40000000\nFrame Time: 0.01\n")
    with little_memory(), pytest.raises(InputError, match="40000000 frames of 1 joints are too many"):
        read_bvh(path)
    path.write_text(path.read_text().replace("40000000", "4"))
    with pytest.raises(InputError, match="no joint has channels"):
        read_bvh(path)


def test_bad_motion_does_not_end_the_reading_of_the_rest(tmp_path: Path) -> None:
    """A bank is built of what is left; each bad file is one line."""
    write_bvh(tmp_path / "good.bvh", load_motion("wave", 25.0, 1.0, 0))
    (tmp_path / "bad.asf").write_text(":root\n order nonsense\n")
    (tmp_path / "bad_01.amc").write_bytes(b"1\nroot \xff 0 0 0 0 0\n")
    (tmp_path / "empty.bvh").write_bytes(b"")
    (tmp_path / "folder.bvh").mkdir()
    os.mkfifo(tmp_path / "pipe.bvh")
    sources = gather_poses(None, 1, tmp_path, False, 10, lambda _: None)
    refused = [str(report) for report in sources.reports if report.refused]
    assert len(refused) == 4
    assert all("\n" not in line for line in refused)
    assert len(sources.poses)


def test_a_command_says_one_line(tmp_path: Path) -> None:
    """Whatever npz file it gets, cut anywhere, renamed, or with an array of another name."""
    np.savez(tmp_path / "renamed.npz", points=np.zeros((3, 19, 3)))
    whole = (tmp_path / "renamed.npz").read_bytes()
    for k, share in enumerate((0.1, 0.5, 0.99)):
        (tmp_path / f"cut{k}.npz").write_bytes(whole[: int(share * len(whole))])
    code = """
import sys
from depth_pose.cli import main
for path in sys.argv[1:]:
    for arguments in ("eval {} x.mcap", "bank info {}", "volume info {}", "bank build -o b.npz --body {}"):
        sys.argv = ["depth-pose", *arguments.format(path).split()]
        try:
            main()
        except SystemExit as end:
            assert end.code in (1, 2), end.code
"""
    paths = sorted(map(str, tmp_path.glob("*.npz")))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", code, *paths]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr
    assert len(done.stderr.strip().splitlines()) == 4 * len(paths), done.stderr
