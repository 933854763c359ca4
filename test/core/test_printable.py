"""Text of others does nothing to a terminal, and looks like no line of ours."""

from __future__ import annotations

import pytest

from depth_pose.core.printable import printable, printable_lines


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("/camera/depth, Ångström 人 0.5 µm", "/camera/depth, Ångström 人 0.5 µm"),
        ("a\x1b[31mb", r"a\x1b[31mb"),
        ("a\nwrote b", r"a\nwrote b"),
        ("a\rb\tc\x07\x08", r"a\rb\tc\x07\x08"),
        ("\x9b2J", r"\x9b2J"),  # an escape sequence of one byte
        ("\u202egnp.a", r"\u202egnp.a"),  # turns the direction of writing
        ("a\u2028b\udcff", r"a\u2028b\udcff"),
    ],
)
def test_what_a_terminal_would_obey_is_shown(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert printable(shown) == shown


def test_lines_are_indented() -> None:
    assert printable_lines("first\nerror: forged\x1b") == "first\n    error: forged\\x1b"
