"""Skeletons as JSON over WebSocket, for web pages and programs in any language.

Each frame is one text message: `depth_pose.People.to_dict`, rounded to 0.1 mm.
"""

from __future__ import annotations

import json
import re
import threading
from types import TracebackType
from typing import TYPE_CHECKING, Any

from depth_pose.core.errors import ConfigError
from depth_pose.core.extras import require
from depth_pose.people import People
from depth_pose.senders.address import LOCAL

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection

_DIGITS, _FINE_DIGITS = 4, 6
"""Decimals of a message's numbers, and of covariances."""

_WAIT_S = 0.5
"""Time after which a client without a new frame is checked, seconds."""

_OWN_PAGES = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?")
"""Origins of this machine's web pages."""


class WebSocketSender:
    """Serves the people of each frame to WebSocket clients; a slow client skips frames.

    Parameters
    ----------
    port : int
        0 chooses a free one.
    host : str
        Address to listen on. By default only programs and web pages of this machine may connect; with
        another host anybody who reaches the port may.

    Attributes
    ----------
    port : int

    Raises
    ------
    ConfigError
        Where websockets is not installed, or the port cannot be used.

    Examples
    --------
    >>> with WebSocketSender(8765) as sender:  # doctest: +SKIP
    ...     for t, depth in frames:
    ...         sender.send(tracker(depth, camera, time=t))
    """

    def __init__(self, port: int, host: str = LOCAL) -> None:
        require("websockets", "a WebSocket server")
        from websockets.sync.server import serve

        self._news = threading.Condition()
        self._text, self._number, self._is_open = "", 0, True
        is_local = host in (LOCAL, "localhost", "::1")
        try:
            self._server = serve(
                self._serve, host, port, origins=[None, _OWN_PAGES] if is_local else None, compression=None
            )
        except OSError as error:
            reason = error.strerror or error
            raise ConfigError(f"the WebSocket server cannot use {host}:{port}: {reason}") from error
        self.port = int(self._server.socket.getsockname()[1])
        self._thread = threading.Thread(target=self._server.serve_forever, name="websocket", daemon=True)
        self._thread.start()

    def send(self, people: People) -> None:
        """Send one frame's people to all clients; returns at once."""
        text = json.dumps(rounded(people.to_dict()), separators=(",", ":"))
        with self._news:
            self._text, self._number = text, self._number + 1
            self._news.notify_all()

    def close(self) -> None:
        """Close all connections, and the port."""
        with self._news:
            self._is_open = False
            self._news.notify_all()
        self._server.shutdown()
        self._thread.join()

    def __enter__(self) -> WebSocketSender:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _serve(self, client: ServerConnection) -> None:
        """Send the newest frame, and each newer one, to one client until either side closes."""
        from websockets.exceptions import ConnectionClosed
        from websockets.protocol import State

        sent = 0
        try:
            while self._is_open and client.state is State.OPEN:
                with self._news:
                    self._news.wait_for(lambda: self._number > sent or not self._is_open, _WAIT_S)  # noqa: B023
                    text, number = self._text, self._number
                if number > sent:
                    client.send(text)
                    sent = number
        except ConnectionClosed:
            return


def rounded(values: Any, digits: int = _DIGITS) -> Any:
    """Return nested values with all floats rounded; covariances, in m^2, more finely."""
    if isinstance(values, float):
        return round(values, digits)
    if isinstance(values, list):
        return [rounded(value, digits) for value in values]
    if isinstance(values, dict):
        return {
            name: rounded(value, _FINE_DIGITS if name == "covariance" else digits)
            for name, value in values.items()
        }
    return values
