"""Parts of a task; light, as every process imports them."""

import os
import signal
import time


def square(number, tell):
    tell(0.5)
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 3:
        raise ValueError("three")
    return number**2 if number != 4 else lambda: "cannot be sent"


def die_once(mark, number, tell):
    if number == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def _leave_id(mark):
    """Write this process's id, whole from the first moment that the file is there."""
    part = mark.with_suffix(".part")
    part.write_text(str(os.getpid()))
    part.replace(mark)


def sleep(mark):
    _leave_id(mark)
    time.sleep(600)


def first_then_sleep(mark, tell):
    _leave_id(mark)
    if mark.name != "0":
        time.sleep(600)
