"""Find the recordings of inputs: files, folders, patterns, recordings split into parts.

A folder is one recording if it has rosbag2's ``metadata.yaml``, or if its files continue one another: the
same name except for the last number, the same topics, each beginning where the previous one ends. A folder of
images without recordings is one if it was given itself or has a ``camera.json``. Any other folder holds
recordings and folders.
"""

from __future__ import annotations

import glob
import logging
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from depth_pose.archive.remote import find_remote, is_remote
from depth_pose.core.errors import ConfigError, InputError
from depth_pose.io._formats import ENDINGS, images_hint
from depth_pose.io._rosbag2_folder import METADATA
from depth_pose.io.image_folder import CAMERA_FILE, image_files
from depth_pose.io.recording import read_span, recording_files

_log = logging.getLogger(__name__)

ENDING = ".mcap"
"""File extension of the skeletons."""

_MOST_GAP_NS = 1_000_000_000
"""Maximum gap between the parts of one recording, nanoseconds: rosbag2 leaves none, separate recordings
have longer ones."""


@dataclass(frozen=True)
class Source:
    """A recording of an archive.

    Attributes
    ----------
    path : Path
        A file, or the folder of a recording's parts or images.
    name : str
        Its name within the archive, ``ward/monday``.
    size : int
        Bytes.
    url : str
        URL of a remote recording, which has no path.
    """

    path: Path
    name: str
    size: int
    url: str = ""

    @property
    def place(self) -> str:
        """Its URL, or its full path."""
        return self.url or str(self.path.resolve())


def is_one_recording(path: Path) -> bool:
    """Whether a path is one recording: a file, or a folder of one recording's parts or images.

    A folder that happens to hold a single recording is not: it is treated like one with several.
    """
    return not path.is_dir() or _is_split(path) or _is_of_images(path)


def _is_split(folder: Path, but: Path | None = None) -> bool:
    """Whether a folder holds the parts of one recording."""
    if (folder / METADATA).exists():
        return True
    files = sorted(folder.glob(f"*{ENDING}"))
    return len(files) > 1 and _carry_on(recording_files(folder)) and not _has_recordings_below(folder, but)


def _has_recordings_below(folder: Path, but: Path | None = None) -> bool:
    below = (file for inside in _folders(folder) for e in ENDINGS for file in inside.rglob(f"*{e}"))
    return any(not _is_within(file, but) for file in below)


def _recordings_in(folder: Path) -> list[Path]:
    """Return the files of a folder that are recordings, judged by their names."""
    return sorted(p for ending in ENDINGS for p in folder.glob(f"*{ending}") if not p.is_dir())


def _is_of_images(folder: Path, but: Path | None = None) -> bool:
    """Whether a folder holds images, and no recordings."""
    if _recordings_in(folder) or _has_recordings_below(folder, but):
        return False
    return bool(image_files(folder))


def _carry_on(files: Sequence[Path]) -> bool:
    if len({re.sub(r"\d+(?=\D*$)", "", file.name) for file in files}) > 1:
        return False
    spans = [read_span(file) for file in files]
    for before, after in pairwise(spans):
        if before is None or after is None or before.topics != after.topics:
            return False
        if not 0 <= after.start_ns - before.end_ns <= _MOST_GAP_NS:
            return False
    return True


def find_sources(inputs: Iterable[str | Path], but: Path | None = None) -> list[Source]:
    """Find the recordings of the inputs, each once, in the order given.

    Parameters
    ----------
    inputs : iterable of str or Path
        Files, folders, and patterns as of `glob`, with ``**`` for folders at any depth; URLs of these.
    but : Path, optional
        A folder to skip, for instance the output.

    Raises
    ------
    InputError
        Where an input does not exist, or has no recording in it.
    ConfigError
        Where two recordings have the same name.
    """
    inputs, but = list(inputs), but.resolve() if but else None
    found: dict[Path, str] = {}
    known: dict[Path, Path] = {}
    remote: list[Source] = []
    for given in inputs:
        if is_remote(str(given)):
            far = [Source(Path(), name, size, url) for url, name, size in find_remote(str(given), ENDING)]
            if not far:
                raise InputError(f"{given}: there is no {ENDING} recording")
            remote += far
            continue
        there = list(_look(str(given), but))
        for path, name in there:
            full = path.resolve()
            if full not in known:
                known[full] = path
                found[path] = name
            elif known[full] != path:
                _log.warning("%s is the same recording as %s: it is run once", path, known[full])
        if not there and not Path(given).exists():
            outside = _outside([given], but)
            raise InputError(f"{given} cannot be read: there is no such file or folder{outside}")
    if not found and not remote:
        where = ", ".join(map(str, inputs)) + _outside(inputs, but)
        hints = {images_hint(Path(given)) for given in inputs if not is_remote(str(given))}
        raise InputError(f"there is no recording ({', '.join(ENDINGS)}) in {where}{''.join(sorted(hints))}")
    found = _with_whole_splits(found)
    local = [Source(path, name, _size(path)) for path, name in _told_apart(found).items()]
    return _with_remote(local, remote)


def _outside(inputs: Sequence[str | Path], but: Path | None) -> str:
    """Return the note that the output's folder is not searched, if an input is inside it."""
    folders = [_fixed_part(str(given)) if glob.has_magic(str(given)) else Path(given) for given in inputs]
    if but and any(_is_within(folder, but) or _is_within(but, folder.resolve()) for folder in folders):
        return f" outside of {but}, which is the output's folder and never read: name another output folder"
    return ""


def _with_remote(local: list[Source], remote: list[Source]) -> list[Source]:
    sources = local + list({source.url: source for source in remote}.values())
    names = Counter(source.name for source in sources)
    for source in remote:
        if names[source.name] > 1:
            raise ConfigError(f"{source.url}: another recording is called {source.name} too; run them apart")
    return sources


def _look(given: str, but: Path | None) -> Iterator[tuple[Path, str]]:
    """Yield the recordings of one input with their names."""
    path = Path(given)
    if path.is_dir() and not _is_within(path, but) and _is_of_images(path, but):
        yield path, _name(path, path)
    elif path.is_dir():
        yield from _walk(path, path, but)
    elif path.exists():
        yield path, _without_ending(path).name
    elif glob.has_magic(given):
        fixed = _fixed_part(given)
        for match in sorted(map(Path, glob.glob(given, recursive=True))):
            if _is_in_circle(match, fixed):
                continue
            if match.is_dir():
                yield from _walk(match, fixed, but)
            elif match.name.endswith(ENDINGS) and not _is_within(match, but):
                yield match, _name(match, fixed)


def _fixed_part(pattern: str) -> Path:
    """Return the fixed folders at the start of a pattern."""
    fixed = Path()
    for part in Path(pattern).parent.parts:
        if glob.has_magic(part):
            break
        fixed /= part
    return fixed


def _is_in_circle(path: Path, root: Path) -> bool:
    """Whether a path leads through the same folder twice below a root, by a link to a folder above."""
    above = [folder.resolve() for folder in path.parents if folder == root or root in folder.parents]
    return len({*above, path.resolve()}) <= len(above)


def _walk(folder: Path, root: Path, but: Path | None) -> Iterator[tuple[Path, str]]:
    if _is_within(folder, but) or _is_in_circle(folder, root):
        return
    if _is_split(folder, but) or ((folder / CAMERA_FILE).is_file() and _is_of_images(folder, but)):
        yield folder, _name(folder, root)
        return
    for file in _recordings_in(folder):
        yield file, _name(file, root)
    for inside in sorted(_folders(folder)):
        yield from _walk(inside, root, but)


def _folders(folder: Path) -> Iterator[Path]:
    return (p for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))


def _is_within(path: Path, folder: Path | None) -> bool:
    return folder is not None and (path.resolve() == folder or folder in path.resolve().parents)


def _name(path: Path, root: Path) -> str:
    if path == root:
        return path.resolve().name
    name = path.relative_to(root)
    return str(name if path.is_dir() else _without_ending(name))


def _without_ending(path: Path) -> Path:
    ending = max((e for e in ENDINGS if path.name.endswith(e)), key=len, default=path.suffix)
    return path.with_name(path.name.removesuffix(ending))


def _with_whole_splits(found: dict[Path, str]) -> dict[Path, str]:
    """Replace the files of a split recording by its folder if all of them were given."""
    whole: dict[Path, str] = {}
    for path, name in found.items():
        folder = path.parent
        parts = recording_files(folder) if (folder / METADATA).exists() and path.is_file() else []
        if len(parts) > 1 and all(part in found for part in parts):
            above = os.path.dirname(name)
            whole.setdefault(folder, above or folder.resolve().name)
        else:
            whole[path] = name
    return whole


def _told_apart(found: dict[Path, str]) -> dict[Path, str]:
    """Add folders to the names of recordings whose file names are the same."""
    if max(Counter(found.values()).values(), default=1) == 1:
        return found
    resolved = {path: path.resolve() for path in found}
    root = Path(os.path.commonpath([p.parent for p in resolved.values()]))
    longer = {path: _name(full, root) for path, full in resolved.items()}
    twice = [name for name, count in Counter(longer.values()).items() if count > 1]
    if twice:
        paths = ", ".join(str(path) for path, name in longer.items() if name == twice[0])
        raise ConfigError(f"{paths}: these have the same name, and so would their outputs; rename one")
    return longer


def _size(path: Path) -> int:
    """Size of a recording, bytes; 0 if it cannot be read, which its row of the report will show."""
    try:
        return sum(file.stat().st_size for file in recording_files(path))
    except OSError:
        return 0
