"""Replicas of a net that train in parallel, one process each, on their shares of the examples.

Two threads of one process gain little here (layers are small, and half of a step is other work); two
processes that average their gradients after each step take half the time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import torch
from torch import Tensor, distributed, multiprocessing

T = TypeVar("T")


class Replica(NamedTuple):
    """One of the replicas: its number, and how many there are."""

    rank: int = 0
    count: int = 1

    def share(self, items: Sequence[T]) -> Sequence[T]:
        """Return this replica's share of the items."""
        return items[self.rank :: self.count]

    def average(self, tensors: Iterable[Tensor]) -> None:
        """Replace tensors by their means over all replicas; every replica must call this."""
        if self.count == 1:
            return
        chosen = list(tensors)
        flat = torch.cat([t.reshape(-1) for t in chosen])
        distributed.all_reduce(flat)
        flat /= self.count
        for tensor, mean in zip(chosen, flat.split([t.numel() for t in chosen]), strict=True):
            tensor.copy_(mean.view_as(tensor))


def run_replicas(work: Callable[..., None], count: int, *arguments: Any) -> None:
    """Call ``work(replica, *arguments)`` in ``count`` processes; if one fails, all are ended."""
    with tempfile.TemporaryDirectory() as folder:
        begin = (count, Path(folder) / "meet", work, arguments)
        multiprocessing.spawn(_begin, begin, nprocs=count)


def _begin(rank: int, count: int, meet: Path, work: Callable[..., None], arguments: tuple[Any, ...]) -> None:
    torch.set_num_threads(1)
    if count > 1:
        distributed.init_process_group("gloo", init_method=f"file://{meet}", rank=rank, world_size=count)
    work(Replica(rank, count), *arguments)
    if count > 1:
        distributed.destroy_process_group()
