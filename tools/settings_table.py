"""Write the table of docs/settings.md from the settings: ``python tools/settings_table.py``."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

from depth_pose.core.config import SHORT_NAMES, PipelineConfig
from depth_pose.core.options import Option, options

PAGE = Path(__file__).parents[1] / "docs" / "settings.md"
HEAD = "| setting | default | range | meaning |\n|---|---|---|---|\n"


def table() -> str:
    """Return the table of all settings, one row each."""
    short = {setting: name for name, setting in SHORT_NAMES.items()}
    rows = []
    for section in fields(PipelineConfig):
        for o in options(section.default):
            name = f"`{section.name}.{o.name}`"
            if (section.name, o.name) in short:
                name += f", in ROS `{short[section.name, o.name]}`"
            rows.append(f"| {name} | {_default(o)} | {_range(o)} | {o.help} |\n")
    return HEAD + "".join(rows)


def _default(o: Option) -> str:
    return str(o.default).lower() if isinstance(o.default, bool) else str(o.default)


def _range(o: Option) -> str:
    return "" if o.low is None or o.high is None else f"{o.low:g} to {o.high:g} {o.unit}".rstrip()


def with_table(page: str) -> str:
    """Return the page with its table replaced by the current one."""
    return re.sub(re.escape(HEAD) + r"(?:\|.*\n)*", lambda _: table(), page)


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
