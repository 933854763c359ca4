"""The command lines of the benchmarks."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from importlib import import_module


def make_parser(text: str | None) -> argparse.ArgumentParser:
    """Make a parser whose help is a module's docstring, line by line."""
    return argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)


def run_part(text: str | None, parts: Mapping[str, str]) -> None:
    """Run the part of a benchmark that the first argument names, with the others.

    Parameters
    ----------
    text : str
        The help.
    parts : mapping of str to str
        Names, and the modules of ``parts`` that do it, each with a ``main``.
    """
    parser = make_parser(text)
    parser.add_argument("part", choices=parts)
    part = parser.parse_args(sys.argv[1:2]).part
    sys.argv[:2] = [f"{sys.argv[0]} {part}"]
    import_module(f"parts.{parts[part]}").main()
