"""Limit the frame rate to what the browsers can draw.

A browser queues everything from the network until it can draw, so a slow one would fall behind and its memory
would grow. After each frame every browser is therefore asked for a value of its local storage, which it
answers after drawing what came before. Until then no other frame is sent.
"""

from __future__ import annotations

import threading
import time
from typing import Any

PATIENCE_S = 5.0
"""Maximum wait for a browser's answer (s); then it is ignored until it answers. Without a
graphics card, on busy cores, it takes 2 s."""

_GIVE_UP_S = 60.0
"""Time (s) without an answer after which a browser is asked again."""

_AFTER_S = 0.03
"""Delay of the question after its frame (s), since the frame itself waits for up to 1/60 s."""


class RateLimit:
    """Waits for a server's browsers.

    Parameters
    ----------
    server : viser.ViserServer
    patience_s : float, optional
        A browser that takes longer is no longer waited for, until it answers.

    Attributes
    ----------
    patience_s : float
    """

    def __init__(self, server: Any, patience_s: float = PATIENCE_S) -> None:
        self.patience_s = patience_s
        self._server = server
        self._lock = threading.Lock()
        self._readers: dict[int, _Reader] = {}

    def is_free(self) -> bool:
        """Return whether another frame may be sent: all responsive browsers have shown the last one."""
        with self._lock:
            return not any(reader.is_awaited(self.patience_s) for reader in self._readers.values())

    def sent(self) -> None:
        """Record that a frame was sent."""
        clients = self._server.get_clients()
        with self._lock:
            for gone in self._readers.keys() - clients.keys():
                self._readers.pop(gone).stop()
            for number in clients:
                if number not in self._readers:
                    self._readers[number] = _Reader(self._server, number)
                self._readers[number].ask()

    def stop(self) -> None:
        """Stop waiting."""
        with self._lock:
            for reader in self._readers.values():
                reader.stop()
            self._readers.clear()


class _Reader:
    """One browser, which is queried in a separate thread."""

    def __init__(self, server: Any, number: int) -> None:
        self._server, self._number = server, number
        self._asked_s: float | None = None  # since when an answer is missing
        self._wanted, self._stopping = threading.Event(), False
        threading.Thread(target=self._run, name="rate_limit", daemon=True).start()

    def is_awaited(self, patience_s: float) -> bool:
        asked = self._asked_s
        return asked is not None and time.monotonic() - asked < patience_s

    def ask(self) -> None:
        if self._asked_s is None:
            self._asked_s = time.monotonic()
            self._wanted.set()

    def stop(self) -> None:
        self._stopping = True
        self._wanted.set()

    def _run(self) -> None:
        while True:
            self._wanted.wait()
            self._wanted.clear()
            if self._stopping:
                return
            time.sleep(_AFTER_S)
            while not self._stopping and not self._answers():
                pass
            self._asked_s = None

    def _answers(self) -> bool:
        """Request and wait; return False on timeout."""
        client = self._server.get_clients().get(self._number)
        if client is None:
            return True
        try:
            client.local_storage.get_item("depth_pose", timeout=_GIVE_UP_S)
        except TimeoutError:
            return False
        except RuntimeError:  # disconnected; or without local storage, which counts as an answer
            pass
        return True
