"""The server of the page, which serves this machine alone.

It listens, and prints its address, before it imports what builds the page: the browser starts in the meantime.
"""

from __future__ import annotations

import gc
import secrets
import socket
import tempfile
import threading
import webbrowser
from collections.abc import Sequence
from pathlib import Path

HOST = "127.0.0.1"
SECONDS_TO_RETURN = 5.0  # after the last page has closed, as a page that is loaded anew closes first
SECONDS_TO_RECONNECT = 900.0  # for a page that is silent, as on a computer that sleeps
GOODBYE = "<script>addEventListener('pagehide', () => navigator.sendBeacon('/closed'))</script>"


def serve(files: Sequence[str], *, open_browser: bool) -> None:
    """Serve the page until it closes; print its address, and open it in the browser if wanted."""
    with socket.create_server((HOST, 0)) as listener, tempfile.TemporaryDirectory(prefix="ancf-casadi-") as folder:
        address = f"{HOST}:{listener.getsockname()[1]}"
        token = secrets.token_urlsafe(24)
        url = f"http://{address}/?token={token}"
        print(f"Open {url} (Ctrl-C, or closing the page, ends it)", flush=True)
        if open_browser:
            threading.Thread(target=webbrowser.open, args=[url], daemon=True).start()
        _serve(files, listener, token, address, Path(folder))


def _serve(files: Sequence[str], listener: socket.socket, token: str, address: str, folder: Path) -> None:
    """Serve the page on a socket that listens."""
    gc.disable()  # the imports make many objects and hardly any garbage
    import uvicorn  # all of these are slow to import
    from fastapi import FastAPI
    from nicegui import Client, app, ui

    from problems.look.guard import Guard
    from problems.look.page import build_page, compute_first
    from problems.look.worker import WORKER

    @ui.page("/", title="ancf-casadi")
    def _page() -> None:
        ui.add_head_html(GOODBYE)
        build_page(files, folder)

    def end_if_closed() -> None:
        server.should_exit |= not any(client.has_socket_connection for client in Client.instances.values())

    if files:  # while the browser starts, so that the page finds the result
        WORKER.submit(compute_first, files)
    WORKER.submit(gc.enable)
    app.on_disconnect(lambda: app.timer(SECONDS_TO_RECONNECT, end_if_closed, once=True))
    server_app = FastAPI()

    @server_app.post("/closed")
    async def _closed() -> None:
        app.timer(SECONDS_TO_RETURN, end_if_closed, once=True)

    server_app.add_middleware(Guard, token=token, address=address)
    ui.run_with(server_app, dark=None, show_welcome_message=False, reconnect_timeout=SECONDS_TO_RECONNECT)
    server = uvicorn.Server(uvicorn.Config(server_app, log_level="error"))
    server.run(sockets=[listener])
