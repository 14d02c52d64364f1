"""The server of the page: it serves this machine alone, and only whoever knows its token.

A page from elsewhere that the browser shows may send requests here.  It does not know the token, which the address in
the terminal holds and a cookie keeps for the requests that follow; and its origin, or the name by which it calls this
machine, is another one (cross-site requests, DNS rebinding).
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import secrets
import socket
import tempfile
import webbrowser
from collections.abc import Awaitable, Callable, MutableMapping, Sequence
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from problems.look.choices import read_takes
from problems.look.page import build_page, kind_of
from problems.look.worker import WORKER

HOST = "127.0.0.1"
COOKIE = "ancf_casadi_token"
SECONDS_TO_RETURN = 5.0  # after the last page has closed, as a page that is loaded anew closes first
Scope = MutableMapping[str, Any]
Channel = Callable[..., Awaitable[Any]]


class Guard:
    """Middleware that refuses requests without the token, from other origins or to other hosts."""

    def __init__(self, app: Callable[..., Awaitable[None]], token: str, address: str) -> None:
        self._app, self._token, self._address = app, token, address

    async def __call__(self, scope: Scope, receive: Channel, send: Channel) -> None:
        """Pass a request on, or answer 403."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        by_query = self._matches(parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0])
        is_known = by_query or self._matches(_cookie(headers.get("cookie", "")))
        is_own = headers.get("host") == self._address and headers.get("origin") in (None, f"http://{self._address}")
        if not (is_known and is_own):
            await _refuse(scope, send)
            return

        async def send_with_cookie(message: Scope) -> None:
            if by_query and message["type"] == "http.response.start":
                cookie = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                message["headers"] = [*message["headers"], (b"set-cookie", cookie.encode())]
            await send(message)

        await self._app(scope, receive, send_with_cookie)

    def _matches(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())


def _cookie(text: str) -> str:
    try:
        cookies = SimpleCookie(text)
    except CookieError:
        return ""
    return cookies[COOKIE].value if COOKIE in cookies else ""


async def _refuse(scope: Scope, send: Channel) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": b"open the address that ancf-casadi look has printed\n"})


async def _wait_until_answered(port: int) -> None:
    """Wait until the server answers."""
    while True:
        with contextlib.suppress(ConnectionRefusedError):
            _, writer = await asyncio.open_connection(HOST, port)
            writer.close()
            return
        await asyncio.sleep(0.05)


def _compute(files: Sequence[str]) -> None:
    """Compute what the page of files shows first, of beams and films nothing."""
    kind = kind_of(files)
    if kind == "functions":
        from problems.look.frf import FrfChoices, fit_modes, frf_poles  # these are slow to import

        choices = FrfChoices(tuple(files))
        frf_poles(choices)
        fit_modes(choices)
    elif kind == "records":
        from problems.look.computation import fit_chosen

        fit_chosen(read_takes(files)[0])


def serve(files: Sequence[str], *, open_browser: bool) -> None:
    """Serve the page until it closes; print its address, and open it in the browser if wanted."""
    from nicegui import Client, app, ui  # slow to import

    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    token, address = secrets.token_urlsafe(24), f"{HOST}:{port}"
    url = f"http://{address}/?token={token}"
    app.add_middleware(Guard, token=token, address=address)

    folder = tempfile.TemporaryDirectory(prefix="ancf-casadi-")

    @ui.page("/", title="ancf-casadi")
    def _page() -> None:
        build_page(files, Path(folder.name))

    async def announce() -> None:
        await _wait_until_answered(port)
        print(f"Open {url} (Ctrl-C, or closing the page, ends it)", flush=True)
        if open_browser:
            webbrowser.open(url)

    def end_if_closed() -> None:
        if not any(client.has_socket_connection for client in Client.instances.values()):
            app.shutdown()

    if files:  # while the browser starts, so that the page finds the result
        WORKER.submit(_compute, files)
    app.on_startup(announce)
    app.on_disconnect(lambda: app.timer(SECONDS_TO_RETURN, end_if_closed, once=True))
    settings: Any = {"show": False, "reload": False, "show_welcome_message": False, "dark": None}
    with folder:
        ui.run(host=HOST, port=port, uvicorn_logging_level="error", **settings)
