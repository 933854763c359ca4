"""Untrusted text on a terminal: names of files, topics, frames and people may hold escape sequences.

All text from recordings, messages and file names goes through `printable` before it is printed or logged:
a terminal executes control characters, and a line break can make a line look like one of ours.
"""

from __future__ import annotations


def printable(text: object) -> str:
    r"""Return text on one line, with control characters as Python escapes.

    Parameters
    ----------
    text : object
        Anything; its ``str`` is taken.

    Returns
    -------
    str
        Control characters, line breaks, invisible marks (such as those that reverse the writing direction)
        and bytes that are not UTF-8 become ``\x1b``, ``\n``, ``\u202e``, ``\udcff``.
    """
    shown = str(text)
    if shown.isprintable():
        return shown
    return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in shown)


def printable_lines(text: object) -> str:
    """Return `printable` lines of a text, all but the first indented, so that none looks like one of ours."""
    return "\n    ".join(printable(line) for line in str(text).split("\n"))
