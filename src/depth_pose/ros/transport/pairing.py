"""Group the messages of several topics by stamp."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any


class Pairer:
    """Holds incomplete sets, a bounded number of stamps; plain Python, no ROS.

    Parameters
    ----------
    inputs : int
        Number of topics.
    capacity : int
        Maximum number of incomplete stamps; the first one is dropped to make room.
    on_drop : callable
        Called with the number of stamps dropped.
    ordered : bool
        Whether a complete set drops earlier incomplete ones: right if the newest frame wins,
        wrong if every frame must be processed.
    """

    def __init__(
        self, inputs: int, capacity: int, on_drop: Callable[[int], None], *, ordered: bool = True
    ) -> None:
        self._inputs = inputs
        self._capacity = capacity
        self._on_drop = on_drop
        self._ordered = ordered
        self._held: OrderedDict[int, list[Any]] = OrderedDict()

    def __len__(self) -> int:
        """Count the incomplete stamps."""
        return len(self._held)

    def add(self, index: int, stamp_ns: int, message: Any) -> tuple[Any, ...] | None:
        """Add a message of topic `index`; return the set if it is complete."""
        entry = self._held.setdefault(stamp_ns, [None] * self._inputs)
        entry[index] = message
        if all(part is not None for part in entry):
            self._complete(stamp_ns)
            return tuple(entry)
        if len(self._held) > self._capacity:
            self._held.popitem(last=False)
            self._on_drop(1)
        return None

    def clear(self) -> None:
        """Forget all incomplete sets, without counting them."""
        self._held.clear()

    def _complete(self, stamp_ns: int) -> None:
        if not self._ordered:
            del self._held[stamp_ns]
            return
        dropped = 0
        while next(iter(self._held)) != stamp_ns:
            self._held.popitem(last=False)
            dropped += 1
        self._held.popitem(last=False)
        if dropped:
            self._on_drop(dropped)
