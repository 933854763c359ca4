"""Output files: written completely or not at all, and never over an input."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from command import environment
from depth_pose.core.errors import InputError
from depth_pose.core.outputs import (
    NewFile,
    check_targets,
    new_file,
    new_text_file,
    own_folder,
    remove_parts,
)


def _names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_a_file_appears_once_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    with new_text_file(path) as stream:
        stream.write("one Ångström\n")
        assert not path.exists()
    assert path.read_bytes() == "one Ångström\n".encode()
    assert _names(path.parent) == ["a.txt"]
    with pytest.raises(ZeroDivisionError), new_file(path) as binary:
        binary.write(b"two")
        raise ZeroDivisionError
    assert path.read_text() == "one Ångström\n"
    assert _names(path.parent) == ["a.txt"]


def test_two_writers_of_one_file_do_not_share_anything(tmp_path: Path) -> None:
    path = tmp_path / "a"
    first, second = NewFile(path), NewFile(path)
    first.stream.write(b"first")
    second.stream.write(b"second")
    first.keep()
    assert path.read_bytes() == b"first"
    second.keep()
    assert path.read_bytes() == b"second"
    assert _names(tmp_path) == ["a"]


def test_a_partial_file_takes_nobodys_name(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"good")
    (tmp_path / "a.partial.mcap").write_bytes(b"earlier")
    file = NewFile(tmp_path / "a.mcap")
    file.stream.write(b"half")
    assert file.keep_partial() == tmp_path / "a.partial2.mcap"
    assert (tmp_path / "a.mcap").read_bytes() == b"good"
    assert (tmp_path / "a.partial.mcap").read_bytes() == b"earlier"
    assert (tmp_path / "a.partial2.mcap").read_bytes() == b"half"
    assert len(_names(tmp_path)) == 3


def test_what_cannot_be_made_again_is_visible_from_the_start(tmp_path: Path) -> None:
    file = NewFile(tmp_path / "a.mcap", visible=True)
    file.stream.write(b"live")
    assert _names(tmp_path) == ["a.partial.mcap"]
    file.keep()
    assert _names(tmp_path) == ["a.mcap"]


def test_an_output_is_no_input_in_any_spelling(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = tmp_path / "in.mcap"
    recording.write_bytes(b"valuable")
    (tmp_path / "link").symlink_to(recording)
    os.link(recording, tmp_path / "hard")
    (tmp_path / "folder").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path)
    spellings = (
        "in.mcap",
        "./in.mcap",
        "folder/in.mcap",
        "link",
        "hard",
        str(tmp_path / "x" / ".." / "in.mcap"),
    )
    (tmp_path / "x").mkdir()
    for name in spellings:
        with pytest.raises(InputError, match="both read and to be written"):
            check_targets([name], [recording])
        with pytest.raises(InputError, match="both read and to be written"):
            check_targets([name], [tmp_path])  # a folder of recordings
    assert recording.read_bytes() == b"valuable"
    before = _names(tmp_path)
    check_targets(["out.mcap", "new/folder/out.mcap"], [recording, None])
    assert _names(tmp_path) == before


def test_targets_that_are_no_files_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"")
    (tmp_path / "null").symlink_to("/dev/null")
    (tmp_path / "nowhere").symlink_to("/nowhere/at/all")
    cases = (
        (tmp_path, "it is a folder"),
        (tmp_path / "pipe", "a device or a pipe"),
        ("/dev/null", "a device or a pipe"),
        (tmp_path / "null", "a device or a pipe"),
        (tmp_path / "file" / "below", "Not a directory|File exists"),
        ("/proc/nothing/here", "cannot be written"),
        (tmp_path / ("n" * 300), "File name too long"),
        (tmp_path / ("n" * 300) / "below", "File name too long"),
        (tmp_path / "nowhere" / "below", "cannot be written"),
    )
    for path, reason in cases:
        with pytest.raises(InputError, match=reason):
            check_targets([path])
        with pytest.raises(InputError, match=reason):
            NewFile(path)
    with pytest.raises(InputError, match="written twice"):
        check_targets([tmp_path / "a", tmp_path / "x" / ".." / "a"])


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"good")
    with pytest.raises(InputError, match="a cannot be written: No space left"), NewFile(path) as file:
        full = os.open("/dev/full", os.O_WRONLY)
        os.dup2(full, file.stream.fileno())  # as if the disk had filled up since
        os.close(full)
        file.stream.write(b"x" * 100_000)
    assert path.read_bytes() == b"good"
    assert _names(tmp_path) == ["a"]


def test_links_are_not_followed(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_bytes(b"valuable")
    (tmp_path / "out").symlink_to(victim)
    with new_file(tmp_path / "out") as stream:
        stream.write(b"new")
    assert victim.read_bytes() == b"valuable"
    assert (tmp_path / "out").read_bytes() == b"new"
    assert not (tmp_path / "out").is_symlink()


_WRITE_AND_WAIT = """
import sys, time
from depth_pose.core.outputs import NewFile
file = NewFile(sys.argv[1])
file.stream.write(b"x")
print("open", flush=True)
time.sleep(60)
"""


def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a"
    command = [sys.executable, "-c", _WRITE_AND_WAIT, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=_environment()) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"open\n"
        remove_parts([path])
        assert len(_names(tmp_path)) == 1, "it is still being written"
        process.kill()
    (tmp_path / ".ab.123.part").write_bytes(b"of another file")
    remove_parts([path])
    assert _names(tmp_path) == [".ab.123.part"]


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}


def test_a_folder_is_held_by_one_process_at_a_time(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "out"
    code = "import sys; from depth_pose.core.outputs import own_folder as own\n"
    code += "with own(sys.argv[1]): print('held')"

    def try_it() -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", code, folder]
        return subprocess.run(command, capture_output=True, text=True, env=environment())

    with own_folder(folder):
        done = try_it()
        assert "another command writes its outputs into" in done.stderr and done.stdout == ""
        (folder / "a").touch()
    done = try_it()
    assert done.stdout == "held\n", done.stderr
    assert _names(folder) == ["a"]


def test_a_held_folder_that_stays_empty_is_removed(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), own_folder(tmp_path / "new" / "out"):
        raise ZeroDivisionError
    assert _names(tmp_path) == []
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="file/out cannot be written"), own_folder(tmp_path / "file" / "out"):
        pass
