"""The command lines of the benchmarks."""

from __future__ import annotations

import argparse


def make_parser(text: str | None) -> argparse.ArgumentParser:
    """Make a parser whose help is a module's docstring, line by line."""
    return argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
