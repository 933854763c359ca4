"""Output files: written completely or not at all, and never over an input.

Everything that writes a file goes through here. `check_targets` refuses, before the work, what cannot
or must not be written; `new_file` and `new_text_file` open a private temporary file
in the target's folder, which takes the target's name once it is complete:

    check_targets([picture], inputs=[recording])
    ...
    with new_file(picture) as stream:
        figure.savefig(stream, format="png")

After an error, or Ctrl-C, the target is as it was before. A temporary file is locked while it is
written, so that the next process can recognise and remove those of killed processes.
"""

from __future__ import annotations

import errno
import io
import os
import secrets
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TextIO

from depth_pose.core.errors import InputError
from depth_pose.core.system import HAS_LOCKS, lock, open_flags, try_lock

_PART = ".part"
_PARTIAL = ".partial"
TRIAL_BYTES = 1 << 16
"""Size of the test file written before the work: a full disk may still take an empty file."""

_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG, errno.EIO, errno.ESTALE)
"""Errors of a system call that only the output can cause."""

AnyPath = Path | str


def check_targets(targets: Iterable[AnyPath | None], inputs: Iterable[AnyPath | None] = ()) -> None:
    """Refuse files that cannot or must not be written, before any work.

    Parameters
    ----------
    targets : iterable of path
        Files to be written; None for outputs that were not requested. The check leaves nothing behind, not
        even folders: the writers make them.
    inputs : iterable of path
        Files, or folders of files, that are read; None for those that were not given.

    Raises
    ------
    InputError
        Where a target is an input, by whatever name or link; is given twice; is a folder or a device; or
        where its folder cannot be written, or has no space.
    """
    wanted = [Path(target) for target in targets if target is not None]
    refuse_inputs(wanted, inputs)
    seen: set[str] = set()
    for path in wanted:
        _check_kind(path)
        place = os.path.join(os.path.realpath(path.parent), path.name)
        if place in seen:
            raise InputError(f"{path} is to be written twice: give each output a name of its own")
        seen.add(place)
        try:
            _try_to_write(path)
        except OSError as error:
            raise _unwritable(path, error) from error


def refuse_inputs(targets: Iterable[AnyPath], inputs: Iterable[AnyPath | None]) -> None:
    """Refuse outputs that are also inputs, by whatever name or link.

    Parameters
    ----------
    targets, inputs : iterable of path
        As for `check_targets`, which does this and more; this checks only existing files.

    Raises
    ------
    InputError
        Where a target is an input.
    """
    read = {identity: path for path in inputs if path is not None for identity in _identities(Path(path))}
    for path in map(Path, targets):
        for identity in () if os.path.isdir(path) else _identities(path):
            if identity in read:
                raise InputError(
                    f"{path} is both read and to be written ({read[identity]}): give the output another name"
                )


def _identities(path: Path) -> Iterator[tuple[int, int]]:
    """Yield device and inode of a file, or of those in a folder; nothing if there is none."""
    with suppress(OSError):
        for file in path.iterdir() if os.path.isdir(path) else [path]:
            found = file.stat()
            yield found.st_dev, found.st_ino


def _check_kind(path: Path) -> None:
    """Refuse an existing target that is not an ordinary file."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise _unwritable(path, error) from error
    if stat.S_ISDIR(mode):
        raise InputError(f"{path} cannot be written: it is a folder; give a file's name")
    if not stat.S_ISREG(mode):
        raise InputError(f"{path} cannot be written: it is a device or a pipe, not a file")


def _try_to_write(path: Path) -> None:
    """Write and remove a small file beside a target, in its nearest existing folder."""
    folder = path.parent
    while not _is_there(folder):
        folder = folder.parent
    part, number = _open_part(folder / path.name)
    try:
        with os.fdopen(number, "wb") as stream:
            stream.write(bytes(TRIAL_BYTES))
    finally:
        part.unlink(missing_ok=True)


def _is_there(path: Path) -> bool:
    """Whether a file, folder or link exists; OSError where it could not be made either."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path} cannot be written: {error.strerror or error}")


class NewFile:
    """A file that gets its name only once it is complete.

    As a context manager it is kept at the end, and discarded after an error. `keep`, `keep_partial`, `leave`
    and `discard` close it earlier; only the first such call has an effect.

    Parameters
    ----------
    path : path
        The file; folders are made, an existing file is replaced once the new one is complete. A
        symbolic link is replaced itself; its target stays as it is.
    visible : bool
        Write under ``NAME.partial.mcap`` from the start, and leave that if the process is killed: for
        data that cannot be made again, like a live recording.

    Attributes
    ----------
    stream : binary stream
        Receives the content.

    Raises
    ------
    InputError
        Where the file cannot be written, now or later.
    """

    def __init__(self, path: AnyPath, visible: bool = False) -> None:
        self.path = Path(path)
        self._visible, self._ended = visible, False
        _check_kind(self.path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not visible:
                remove_parts([self.path])
            self._part, number = _open_partial(self.path) if visible else _open_part(self.path)
        except OSError as error:
            raise _unwritable(self.path, error) from error
        self.stream: BinaryIO = os.fdopen(number, "w+b")

    def keep(self) -> None:
        """Finish the file and give it its name."""
        if not self._ended:
            self._finish()
            os.replace(self._part, self.path)

    def keep_partial(self) -> Path:
        """Finish the incomplete file under the name ``NAME.partial.mcap``; return its path."""
        self._finish()
        if self._visible:
            return self._part
        partial, number = _open_partial(self.path)  # a name that does not exist yet
        os.close(number)
        os.replace(self._part, partial)
        return partial

    def _finish(self) -> None:
        try:
            with self.telling():
                self.stream.flush()
                with suppress(OSError):  # not supported by the system; a full disk has been reported by now
                    os.fsync(self.stream.fileno())
                self.stream.close()
        except BaseException:
            self.discard()
            raise
        self._ended = True

    def leave(self) -> Path:
        """Keep the part of a visible file that has reached the disk; return its path."""
        self._ended = True
        with suppress(OSError):
            self.stream.close()
        return self._part

    def discard(self) -> None:
        """Discard what was written."""
        if not self._ended:
            self._ended = True
            with suppress(OSError):  # on a full disk, for data not yet flushed
                self.stream.close()
            self._part.unlink(missing_ok=True)

    @contextmanager
    def telling(self) -> Iterator[None]:
        """Raise `InputError` that names the file instead of OSError when the disk is full or fails."""
        try:
            yield
        except OSError as error:
            if error.errno in _DISK_ERRORS:
                raise _unwritable(self.path, error) from error
            raise

    def __enter__(self) -> NewFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: object) -> None:
        if kind is None:
            self.keep()
            return
        self.discard()
        if isinstance(error, OSError):
            with self.telling():
                raise error


def _open_part(path: Path) -> tuple[Path, int]:
    """Open a new, locked, hidden file beside the target; return its path and its descriptor."""
    while True:
        part = path.with_name(f".{path.name}.{secrets.token_hex(6)}{_PART}")
        number = _create(part)
        if os.fstat(number).st_nlink:  # otherwise another process removed it before it was locked
            return part, number
        os.close(number)


def _open_partial(path: Path) -> tuple[Path, int]:
    """Open a new file ``NAME.partial.mcap``, or ``NAME.partial2.mcap``, that was not there before."""
    count = 1
    while True:
        partial = path.with_name(f"{path.stem}{_PARTIAL}{count if count > 1 else ''}{path.suffix}")
        try:
            return partial, _create(partial)
        except FileExistsError:
            count += 1


def _create(path: Path) -> int:
    """Create and lock a file that was not there; no link is followed."""
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | open_flags("O_NOFOLLOW", "O_CLOEXEC")
    number = os.open(path, flags, 0o666)
    lock(number)
    return number


def remove_parts(paths: Iterable[AnyPath]) -> None:
    """Remove temporary files that killed writers of these targets have left beside them."""
    names: dict[Path, list[str]] = {}
    for path in map(Path, paths):
        names.setdefault(path.parent, []).append(f".{path.name}.")
    for folder, beginnings in names.items():
        with suppress(OSError):
            for part in list(folder.glob(f".*{_PART}")):
                if part.name.startswith(tuple(beginnings)):
                    _remove_if_left(part)


def _remove_if_left(part: Path) -> None:
    """Remove a temporary file that is not locked."""
    with suppress(OSError):
        number = os.open(part, os.O_RDWR | open_flags("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"))
        try:
            try_lock(number)
            if HAS_LOCKS:
                part.unlink()
        finally:
            os.close(number)
        if not HAS_LOCKS:  # where an open file cannot be removed
            part.unlink()


@contextmanager
def own_folder(folder: AnyPath) -> Iterator[None]:
    """Lock a folder of outputs, so that no other process writes another set of them into it.

    Parameters
    ----------
    folder : path
        The folder; it is made, and removed at the end if nothing came into it.

    Raises
    ------
    InputError
        Where another process holds it, or it cannot be made.
    """
    path = Path(folder)
    made = [place for place in (path, *path.parents) if not place.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        number = _open_folder(path)
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        if number is not None:
            _lock_or_refuse(path, number)
        yield
    finally:
        if number is not None:
            os.close(number)
        with suppress(OSError):  # the first that is not empty
            for place in made:
                place.rmdir()


def _open_folder(path: Path) -> int | None:
    """Open a folder for its lock; None where the system has no locks, and opens no folders."""
    return os.open(path, os.O_RDONLY | open_flags("O_DIRECTORY", "O_CLOEXEC")) if HAS_LOCKS else None


def _lock_or_refuse(path: Path, number: int) -> None:
    try:
        try_lock(number)
    except BlockingIOError as error:
        raise InputError(
            f"another command writes its outputs into {path}: wait for its end, or give another folder"
        ) from error
    except OSError:  # some file systems have no locks
        return


@contextmanager
def new_file(path: AnyPath) -> Iterator[BinaryIO]:
    """Write a file of bytes that gets its name only once it is complete.

    Parameters
    ----------
    path : path
        As of `NewFile`.

    Yields
    ------
    binary stream

    Raises
    ------
    InputError
        Where the file cannot be written.
    """
    with NewFile(path) as file:
        yield file.stream


@contextmanager
def new_text_file(path: AnyPath, newline: str | None = None) -> Iterator[TextIO]:
    """Write a file of UTF-8 text that gets its name only once it is complete; as `new_file`.

    ``newline`` is as of `open`; the `csv` module wants "".
    """
    with NewFile(path) as file:
        text = io.TextIOWrapper(file.stream, encoding="utf-8", newline=newline, write_through=True)
        try:
            yield text
            text.flush()
        finally:
            with suppress(OSError, ValueError):
                text.detach()
