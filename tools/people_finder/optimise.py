"""The loop that trains a net: one cycle of rates, averaged weights, checkpoints and a log."""

from __future__ import annotations

import copy
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import torch
from replicas import Replica
from rich.progress import Progress
from torch import Tensor, nn

Net = TypeVar("Net", bound=nn.Module)

_EMA, _WEIGHT_DECAY, _WARM_UP, _CLIP = 0.998, 1e-4, 0.05, 5.0
"""Decay of the averaged weights per step, weight decay, share of the steps in which the rate rises, and
largest norm of a gradient. Set by hand."""


class Plan(NamedTuple):
    """Schedule: examples in all and per step, highest rate, examples between checkpoints.

    Examples are counted over all replicas.
    """

    images: int
    batch: int
    rate: float
    save_every: int
    seed: int


def arithmetic(exact: bool | None, device: str = "cpu") -> torch.autocast:
    """Return the context of a net's forward pass: bfloat16, or 32 bits throughout.

    The default is bfloat16 where the processor supports it; others emulate it, at twice the time of 32 bits.
    """
    if exact is None:
        has = torch.cpu.get_capabilities()
        exact = device == "cpu" and not (has.get("amx_bf16") or has.get("avx512_bf16"))
    # casts are not kept: those of a recorded step would outlive it
    return torch.autocast(device, torch.bfloat16, enabled=not exact, cache_enabled=device == "cpu")


def optimise(
    make: Callable[[], Net],
    loss_of: Callable[[Net], tuple[Tensor, dict[str, float]]],
    plan: Plan,
    replica: Replica,
    out: Path,
    start: Path | None,
    remark: Callable[[Net], dict[str, Any]],
) -> None:
    """Train a net; writes OUT/NNNNNNN.pt every so often, and OUT/last.pt.

    Parameters
    ----------
    make : callable
        Function that builds the net.
    loss_of : callable
        Function that returns the loss of this replica's part of the next batch, and its parts for the log.
    plan : Plan
    replica : Replica
        This process; the first replica writes files and logs.
    out : Path
        Folder for checkpoints and ``log.jsonl``.
    start : Path, optional
        Checkpoint to continue from.
    remark : callable
        Function that returns further log entries for the averaged net.
    """
    torch.manual_seed(plan.seed)
    out.mkdir(parents=True, exist_ok=True)
    net = make()
    if start is not None:
        net.load_state_dict(torch.load(start, weights_only=True))
    net = net.to(memory_format=torch.channels_last)
    average = copy.deepcopy(net).eval()
    optimiser = torch.optim.AdamW(net.parameters(), plan.rate, weight_decay=_WEIGHT_DECAY, fused=True)
    steps = plan.images // plan.batch
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, plan.rate, total_steps=steps + 1, pct_start=_WARM_UP, div_factor=10, final_div_factor=100
    )
    mean: dict[str, float] = {}
    saved, began = 0, time.perf_counter()
    with Progress(disable=replica.rank > 0) as progress, (out / "log.jsonl").open("a") as log:
        task = progress.add_task("training", total=steps)
        for step in range(steps):
            loss, parts = loss_of(net)
            optimiser.zero_grad()
            loss.backward()
            with torch.no_grad():
                replica.average(p.grad for p in net.parameters())
            torch.nn.utils.clip_grad_norm_(net.parameters(), _CLIP)
            optimiser.step()
            schedule.step()
            follow(average, net, min(_EMA, (1 + step) / (10 + step)))
            mean = {k: 0.98 * mean.get(k, v) + 0.02 * v for k, v in parts.items()}
            progress.update(task, advance=1, description=" ".join(f"{k} {v:.3f}" for k, v in mean.items()))
            done = (step + 1) * plan.batch
            if done - saved >= plan.save_every or step + 1 == steps:
                saved = done
                replica.average(b for b in average.buffers() if b.is_floating_point())
                if replica.rank > 0:
                    continue
                torch.save(average.state_dict(), out / f"{done:07d}.pt")
                line = {"images": done, "seconds": time.perf_counter() - began, **mean, **remark(average)}
                print(json.dumps(line), file=log, flush=True)
    if replica.rank == 0:
        torch.save(average.state_dict(), out / "last.pt")


def follow(average: nn.Module, net: nn.Module, keep: float) -> None:
    """Move the averaged weights towards the net's."""
    with torch.no_grad():
        own, others = ([*n.parameters(), *n.buffers()] for n in (average, net))
        floats = [k for k, a in enumerate(own) if a.is_floating_point()]
        torch._foreach_lerp_([own[k] for k in floats], [others[k] for k in floats], 1 - keep)
        for k in set(range(len(own))) - set(floats):
            own[k].copy_(others[k])
