"""Text of others on a terminal: names of files, topics, frames and people may hold escape sequences.

Everything that a recording, a message or a file's name says goes through `printable` before it is printed or
logged: a terminal obeys control characters, and a line break can make a line look like one of ours.
"""

from __future__ import annotations


def printable(text: object) -> str:
    r"""Return text on one line, with whatever a terminal would obey as its escape in Python.

    Parameters
    ----------
    text : object
        Anything; its ``str`` is taken.

    Returns
    -------
    str
        Control characters, line breaks, invisible marks (such as those that turn the direction of writing)
        and bytes that are no UTF-8 stand as ``\x1b``, ``\n``, ``\u202e``, ``\udcff``.
    """
    shown = str(text)
    if shown.isprintable():
        return shown
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in shown)


def printable_lines(text: object) -> str:
    """Return `printable` lines of a text, all but the first indented: none passes for one of ours."""
    return "\n    ".join(printable(line) for line in str(text).split("\n"))
