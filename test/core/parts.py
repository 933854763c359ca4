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


def sleep(mark):
    mark.write_text(str(os.getpid()))
    time.sleep(60)


def first_then_sleep(mark, tell):
    mark.write_text(str(os.getpid()))
    if mark.name != "0":
        time.sleep(60)
