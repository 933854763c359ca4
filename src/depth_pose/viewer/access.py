"""Access control of the viewer: programs and its own page may connect, pages of other sites may not.

A browser lets any visited page open a websocket to a port of its own machine and read the answers (RFC 6455,
section 10.2), so listening on the loopback interface excludes no web page. With each connection the browser
sends the origin of the page in ``Origin``. A page whose name was rebound to this machine (DNS rebinding) is
recognised by the server name that it sends in ``Host``.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from http import HTTPStatus
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Addresses to listen on that other machines cannot reach."""


def refusal(hosts: Sequence[str], origins: Sequence[str], is_local: bool) -> str:
    """Return the reason for refusing a request; empty to accept it.

    Parameters
    ----------
    hosts, origins : sequence of str
        Its headers ``Host`` and ``Origin``; programs send none of the latter.
    is_local : bool
        Whether only this machine is served: then the host name must always denote this machine.
    """
    if len(hosts) != 1 or len(origins) > 1:
        return "a request has one Host, and at most one Origin"
    if is_local and not _is_fixed(hosts[0]):
        return f"{hosts[0]} is not a loopback name; open the viewer as localhost or 127.0.0.1"
    if origins and _place(origins[0]) != hosts[0].lower():
        return f"a page of {origins[0]} may not connect to this viewer"
    return ""


def _place(origin: str) -> str:
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


def _is_fixed(host: str) -> bool:
    """Whether a name cannot be redirected by its owner: an address, or localhost."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        if name == "localhost" or name.endswith(".localhost"):
            return True
        ip_address(name)
    except ValueError:
        return False
    return True


@contextmanager
def own_pages_only(host: str) -> Iterator[None]:
    """Make the server started inside refuse requests by `refusal`.

    `viser` has no setting for it; it starts its server by ``websockets.asyncio.server.serve``, whose hook for
    requests comes before the one that it sets itself.
    """
    from websockets.asyncio import server

    serve, is_local = server.serve, host in LOOPBACK

    def guarded(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        async def check(connection: Any, request: Any) -> Any:
            headers = request.headers
            reason = refusal(headers.get_all("Host"), headers.get_all("Origin"), is_local)
            if reason:
                return connection.respond(HTTPStatus.FORBIDDEN, reason + "\n")
            answer = process_request(connection, request) if process_request is not None else None
            return await answer if inspect.isawaitable(answer) else answer

        return serve(*arguments, process_request=check, **options)

    server.serve = guarded  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
