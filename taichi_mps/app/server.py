"""The server of the page: for this machine only, with the queue of runs, and nothing left behind at its end."""

import asyncio
import os
import re
import signal
import socket
import webbrowser
from urllib.parse import parse_qs, unquote_to_bytes

import uvicorn
from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import FileResponse
from nicegui import app as pages
from nicegui import run, ui
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse

from ..io.run_folder import PICTURES, PLOTS, RunFolder
from ..units import SceneError, plain
from .jobs import Queue
from .page import Page
from .results import SAVED

HERE = "127.0.0.1"
REFUSED = "Only for this machine: type the address into the browser."
CONNECTS_WITHIN = 60.0  # [s]: a page whose browser does not come back is dropped, empty as it is
SHOWN = {"animation.gif", *PLOTS}  # files of a run that the page shows, besides PICTURE
PICTURE = re.compile(rf"frames/{PICTURES.pattern}|animation-beside-[^/]+\.gif")


class OnlyHere:
    """Refuses what a page of another host asks through a browser on this machine: requests by a name of another host
    (DNS rebinding), from another origin, for a picture or a script in a foreign page, and the page in a frame."""

    def __init__(self, app, port: int):
        self.app = app
        self.hosts = {f"{HERE}:{port}", f"localhost:{port}"}
        self.origins = {f"http://{host}" for host in self.hosts}

    async def __call__(self, scope, receive, send):
        async def framed_by_none(message):
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers["Content-Security-Policy"] = "frame-ancestors 'none'"
                headers["Cross-Origin-Resource-Policy"] = "same-origin"
            await send(message)

        if scope["type"] == "lifespan" or self.allows(scope):
            await self.app(scope, receive, framed_by_none)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse(REFUSED, 403)(scope, receive, framed_by_none)

    def allows(self, scope) -> bool:
        """Whether the request was made to this machine by its own page, or by hand, and for no script (JSONP)."""
        headers = Headers(scope=scope)
        at_home = headers.get("host") in self.hosts and set(headers.getlist("origin")) <= self.origins
        asked_by = set(headers.getlist("sec-fetch-site")) <= {"same-origin", "none"}
        return at_home and asked_by and "j" not in parse_qs(scope["query_string"].decode("latin-1"), True)


def file_of(folder, run: str, name: str) -> FileResponse:
    """A file of a run in a folder of runs; 404 for any other. One that a browser would run as a page is only given to
    keep, since a run may come from anybody."""
    known = name in SHOWN | set(SAVED) or PICTURE.fullmatch(name)
    try:
        run_folder = RunFolder(folder / run)
        path = run_folder.path / name
        inside = path.is_file() and path.resolve() == run_folder.path.resolve() / name and run_folder.ours
    except (OSError, ValueError):  # a name that is too long, or has a zero in it
        inside = False
    if run in ("", ".", "..") or "/" in run or not known or not inside:
        raise HTTPException(404)
    headers = {"Cache-Control": "no-cache", "X-Content-Type-Options": "nosniff"}
    return FileResponse(path, headers=headers, filename=f"{plain(run)}-{name}" if name in SAVED else None)


def serve(port: int, folder, browser: bool) -> None:
    """Serve the page of the runs in ``folder`` on 127.0.0.1 until a signal; port 0 is any free one."""
    try:
        listener = socket.create_server((HERE, port))
    except OSError as error:
        why = os.strerror(error.errno)
        raise SceneError(f"port = {port}: cannot be used ({why}); choose another, or 0 for any") from None
    port = listener.getsockname()[1]
    address = f"http://{HERE}:{port}/"
    queue, server_app = Queue(folder), FastAPI(openapi_url=None)

    @server_app.get("/runs/{name}/{file:path}")
    def run_file(file: str, request: Request) -> FileResponse:
        name = os.fsdecode(unquote_to_bytes(request.scope["raw_path"].split(b"/")[2]))  # which need be no UTF-8
        return file_of(queue.folder, name, file)

    @ui.page("/", title="taichi_mps")
    async def page():
        await ui.context.client.connected(CONNECTS_WITHIN)  # before that a request costs next to nothing
        Page(queue)

    ui.run_with(server_app, show_welcome_message=False, favicon="🧱")
    run.process_pool_start_method = "spawn"  # of the forecasts
    pages.on_startup(queue.adopt)
    pages.on_shutdown(queue.close)
    if browser:
        pages.on_startup(lambda: asyncio.get_running_loop().run_in_executor(None, webbrowser.open, address))
    print(f"{address} shows the runs in {queue.folder}; Ctrl-C ends it", flush=True)
    if hasattr(signal, "SIGHUP"):  # its terminal was closed
        signal.signal(signal.SIGHUP, lambda *_: os.kill(os.getpid(), signal.SIGTERM))
    settings = uvicorn.Config(
        OnlyHere(server_app, port), log_level="warning", lifespan="on", timeout_graceful_shutdown=1
    )
    try:
        uvicorn.Server(settings).run(sockets=[listener])
    finally:
        queue.kill()
