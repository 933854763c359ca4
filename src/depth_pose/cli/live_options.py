"""Options that send skeletons to other programs while they are found."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from depth_pose.core.extras import require
from depth_pose.senders.address import Address, parse_address

if TYPE_CHECKING:
    from depth_pose.pipeline import FrameResult


@dataclass(frozen=True)
class LiveOptions:
    """Where skeletons are sent, and whether a recording is played as fast as it was made."""

    osc: Address | None
    websocket: Address | None
    real_time: bool

    @classmethod
    def parse(cls, osc: str | None, websocket: str | None, real_time: bool) -> LiveOptions:
        """Parse the options, and check that what they need is installed.

        Raises
        ------
        ConfigError
            Where an address is invalid, or a package is missing.
        """
        if osc is not None:
            require("pythonosc", "--osc")
        if websocket is not None:
            require("websockets", "--websocket")
        return cls(
            None if osc is None else parse_address(osc, "--osc"),
            None if websocket is None else parse_address(websocket, "--websocket"),
            real_time,
        )

    @property
    def is_used(self) -> bool:
        """Whether any of them is given."""
        return bool(self.osc or self.websocket or self.real_time)

    @property
    def flags(self) -> str:
        """Those that are given."""
        given = {"--osc": self.osc, "--websocket": self.websocket, "--real-time": self.real_time}
        return ", ".join(flag for flag, value in given.items() if value)

    @contextmanager
    def sending(self) -> Iterator[Callable[[FrameResult], None] | None]:
        """Open the senders; yields a function that takes each frame's result, None without senders."""
        from depth_pose.people import People
        from depth_pose.senders.osc import OscSender
        from depth_pose.senders.websocket import WebSocketSender

        with ExitStack() as stack:
            senders: list[OscSender | WebSocketSender] = []
            if self.osc is not None:
                senders.append(stack.enter_context(OscSender(self.osc.port, self.osc.host)))
            if self.websocket is not None:
                senders.append(stack.enter_context(WebSocketSender(self.websocket.port, self.websocket.host)))
            if not senders:
                yield None
                return

            def tell(result: FrameResult) -> None:
                followed = result.skeleton
                people = People(result.skeletons, followed.stamp_ns, followed.frame_id, floor=result.floor)
                for sender in senders:
                    sender.send(people)

            yield tell
