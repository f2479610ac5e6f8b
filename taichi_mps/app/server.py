"""HTTP server of the page, for this machine only; it ends its processes when it ends."""

import asyncio
import json
import logging
import os
import re
import secrets
import signal
import socket
import webbrowser
from contextlib import asynccontextmanager
from inspect import isawaitable
from pathlib import Path
from urllib.parse import unquote_to_bytes

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware.base import BaseHTTPMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, RedirectResponse, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from ..io.run_folder import PICTURE_NAME, REPORT, RunFolder, strict
from ..report.page import PAGE_PARTS
from ..units import SceneError, plain
from .form import wrong
from .jobs import Queue
from .page import Page, Query
from .results import SAVED

LOCALHOST = "127.0.0.1"
REFUSED = "Only for this machine: type the address into the browser."
NO_TOKEN = "The address lacks its token: taichi-mps app prints the whole of it where it was started."
STATIC = Path(__file__).with_name("static")
DRAWN = "charts.js", "viewer.js", "film.js"  # scripts of a report that the page draws with, too
MAX_REQUEST_BYTES, MAX_LIST_BYTES = 100_000, 10_000_000  # of a query; of one with a laboratory's list
PICTURE = re.compile(rf"frames/{PICTURE_NAME.pattern}")
PAGE_POLICY = "default-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
COMMON_HEADERS = {
    "Cache-Control": "no-cache",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
}
# of a report, which may come from anybody: an origin of its own, that reaches nothing
REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'unsafe-inline' data: blob:; connect-src 'none'; "
    "frame-ancestors 'none'"
)


def same(given: str | None, token: str) -> bool:
    """Whether what was given is the token, compared in a time that does not tell how much of it is right."""
    return bool(token and given) and secrets.compare_digest(given.encode(), token.encode())


class OnlyHere(BaseHTTPMiddleware):
    """Middleware that refuses requests of foreign pages through a browser on this machine: by a name of another host
    (DNS rebinding), from another origin, for a picture or a script in a foreign page, and the page in a frame; and all
    requests, by whatever program of this machine, without the token. A browser has it from the address that it opened
    first, and then in a cookie. ``once``: another that is good once, since the list of processes shows to everybody
    with which address a browser was started. An empty token lets all in."""

    def __init__(self, app, port: int, token: str, once: str):
        super().__init__(app)
        self.hosts = {f"{LOCALHOST}:{port}", f"localhost:{port}"}
        self.origins = {f"http://{host}" for host in self.hosts}
        self.token, self.once = token, once
        self.cookie = f"taichi_mps_{port}"  # a browser sends its cookies to all ports of a machine

    async def dispatch(self, request: Request, call_next):
        """Answer allowed requests, with headers that forbid frames, and others by 403."""
        given, allowed = request.query_params.get("token"), self.allows(request)
        if allowed and (first := same(given, self.once)):
            self.once = ""
        if not allowed:
            answer = PlainTextResponse(REFUSED, 403)
        elif first or same(given, self.token):
            answer = RedirectResponse("/", 303)  # the token stays neither in the address nor in what links to others
            answer.set_cookie(self.cookie, self.token, httponly=True, samesite="strict")
        elif not self.token or same(request.cookies.get(self.cookie), self.token):
            answer = await call_next(request)
        else:
            answer = PlainTextResponse(NO_TOKEN, 403)
        answer.headers.setdefault("Content-Security-Policy", PAGE_POLICY)
        answer.headers.update(COMMON_HEADERS)
        return answer

    def allows(self, request: Request) -> bool:
        """Whether the request was made to this machine by its own page, or by hand, and for no script (JSONP). What
        changes anything comes as JSON, which no form of another page can send."""
        headers = request.headers
        at_home = headers.get("host") in self.hosts and set(headers.getlist("origin")) <= self.origins
        same_site = set(headers.getlist("sec-fetch-site")) <= {"same-origin", "none"}
        known = request.method in ("GET", "HEAD") or headers.get("content-type") == "application/json"
        return at_home and same_site and known and "j" not in request.query_params


def file_of(folder, run: str, name: str) -> FileResponse:
    """Response with a file of a run in a folder of runs; 404 for any other file. A file that a browser would execute as
    a page is sent as a download, since a run may come from anybody."""
    served = name in {"animation.gif", *SAVED} or PICTURE.fullmatch(name)
    try:
        run_folder = RunFolder(folder / run)
        path = run_folder.path / name
        inside = path.is_file() and path.resolve() == run_folder.path.resolve() / name and run_folder.ours
    except (OSError, ValueError):  # a name that is too long, or has a zero in it
        inside = False
    if run in ("", ".", "..") or "/" in run or not served or not inside:
        raise HTTPException(404)
    return FileResponse(path, filename=f"{plain(run)}-{name}" if name in SAVED else None)


def routes(page: Page) -> list[Route]:
    """Routes of the server: the page, its queries, and files of runs."""

    async def start(request: Request):
        return FileResponse(STATIC / "index.html")

    async def drawing(request: Request):
        return FileResponse(PAGE_PARTS / request.url.path[1:])

    def run_of(request: Request) -> str:
        return os.fsdecode(unquote_to_bytes(request.scope["raw_path"].split(b"/")[2]))  # which need be no UTF-8

    async def run_file(request: Request):
        return file_of(page.queue.folder, run_of(request), request.path_params["file"])

    async def report(request: Request):
        return FileResponse(
            file_of(page.queue.folder, run_of(request), REPORT).path, headers={"Content-Security-Policy": REPORT_POLICY}
        )

    async def answer(request: Request):
        what = request.path_params["what"]
        most = MAX_LIST_BYTES if what == "calibrate_list" else MAX_REQUEST_BYTES
        if int(request.headers.get("content-length", most)) >= most:
            raise HTTPException(413)
        try:
            query = Query(**json.loads(await request.body()))
            if what == "preview":
                return StreamingResponse(lines_of(page.preview(query)), media_type="application/x-ndjson")
            if what not in page.answers:
                raise HTTPException(404)
            result = page.answers[what](query)
            return JSONResponse(strict(await result if isawaitable(result) else result or {}))
        except (OSError, ValueError, TypeError, RecursionError) as error:  # SceneError is a ValueError
            return JSONResponse({"wrong": wrong(error)})

    return [
        Route("/", start),
        *(Route(f"/{name}", drawing) for name in DRAWN),
        Mount("/static", StaticFiles(directory=STATIC)),
        Route("/runs/{name}/{file:path}", run_file),
        Route("/report/{name}", report),
        Route("/ask/{what}", answer, methods=["POST"]),
    ]


async def lines_of(parts):
    """Yield the parts of an answer as lines of JSON."""
    try:
        async for part in parts:
            yield json.dumps(part) + "\n"
    except SceneError as error:
        yield json.dumps({"wrong": plain(error)}) + "\n"


class Server(uvicorn.Server):
    """Server that is silent about the requests that its end cuts off: a browser may still ask."""

    async def shutdown(self, sockets=None):
        """End, without their tracebacks."""
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await super().shutdown(sockets)


def serve(port: int, folder, browser: bool, token: str | None = None) -> None:
    """Serve the page of the runs in ``folder`` on 127.0.0.1 until a signal; port 0 stands for any free port, no
    ``token`` for one drawn anew."""
    token, once = secrets.token_urlsafe() if token is None else token, secrets.token_urlsafe()
    try:
        listener = socket.create_server((LOCALHOST, port))
    except OSError as error:
        raise SceneError(
            f"port = {port}: cannot be used ({os.strerror(error.errno)}); choose another, or 0 for any"
        ) from None
    port = listener.getsockname()[1]
    address, opened = (f"http://{LOCALHOST}:{port}/{f'?token={word}' if token else ''}" for word in (token, once))
    queue = Queue(folder)
    page = Page(queue)
    processes = page.preview_process, page.forecast_process

    @asynccontextmanager
    async def life(app):
        if browser:
            asyncio.get_running_loop().run_in_executor(None, webbrowser.open, opened)
        yield
        await asyncio.gather(queue.close(), *(process.close() for process in processes))

    print(f"{address} shows the runs in {queue.folder}; Ctrl-C ends it", flush=True)
    if hasattr(signal, "SIGHUP"):  # its terminal was closed
        signal.signal(signal.SIGHUP, lambda *_: os.kill(os.getpid(), signal.SIGTERM))
    app = OnlyHere(Starlette(routes=routes(page), lifespan=life), port, token, once)
    settings = uvicorn.Config(app, log_level="warning", lifespan="on", timeout_graceful_shutdown=1, ws="none")
    try:
        Server(settings).run(sockets=[listener])
    finally:
        queue.kill()
        for process in processes:
            process.kill()
        print(f"The runs lie in {queue.folder.resolve()}", flush=True)
