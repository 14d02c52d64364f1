"""Middleware that answers whoever knows the token of the page, and nobody else.

A page from elsewhere that the browser shows may send requests here.  It does not know the token, which the address in
the terminal holds and a cookie keeps for the requests that follow; and its origin, or the name by which it calls this
machine, is another one (cross-site requests, DNS rebinding).
"""

from __future__ import annotations

import hmac

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

COOKIE = "ancf_casadi_token"


class Guard:
    """Middleware that refuses requests without the token, from other origins or to other hosts."""

    def __init__(self, app: ASGIApp, token: str, address: str) -> None:
        self.app, self._token, self._address = app, token, address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer 403."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        request = HTTPConnection(scope)
        by_query = self._matches(request.query_params.get("token", ""))
        is_known = by_query or self._matches(request.cookies.get(COOKIE, ""))
        is_here = request.headers.get("host") == self._address
        if not (is_known and is_here and request.headers.get("origin") in (None, f"http://{self._address}")):
            refusal = PlainTextResponse("open the address that ancf-casadi look has printed\n", 403)
            await refusal(scope, receive, send)
            return

        async def send_with_cookie(message: Message) -> None:
            if by_query and message["type"] == "http.response.start":
                cookie = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                MutableHeaders(scope=message).append("set-cookie", cookie)
            await send(message)

        await self.app(scope, receive, send_with_cookie)

    def _matches(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self._token.encode())
