"""Little memory for what must not take much: asking for more fails, whatever was in use before."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def little_memory(megabytes: int = 512) -> Iterator[None]:
    """Limit this process to this much more memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + (megabytes << 20), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def yaml_bombs() -> tuple[str, str]:
    """Two kilobytes of YAML that stand for 9^29 values: by lists of lists, and by keys that are merged."""

    def nine(i: int) -> str:
        return ",".join([f"*a{i - 1}"] * 9)

    lists = "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [{nine(i)}]\n" for i in range(1, 30))
    merged = "a0: &a0 {x: 1}\n" + "".join(f"a{i}: &a{i} {{<<: [{nine(i)}]}}\n" for i in range(1, 30))
    return lists, merged
