"""The server of the page: static files, and the questions of the page answered by a `Session`; this machine only."""

from __future__ import annotations

import signal
import socket
import sys
import threading
import traceback
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hbbogie.errors import ModelError
from hbbogie.explorer.session import Session
from hbbogie.explorer.view import Mistakes
from hbbogie.results.failure import FAILURES

if TYPE_CHECKING:
    from starlette.applications import Starlette

HERE = "127.0.0.1"
PORT = 8765
PAGE = Path(__file__).with_name("page")
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:",
}


def application(session: Session) -> Starlette:
    """Return the web application of a session, which answers to names of this machine only.

    Parameters
    ----------
    session : Session

    Raises
    ------
    ModelError
        When the extra that it needs is not installed.
    """
    try:
        from starlette.applications import Starlette
        from starlette.concurrency import run_in_threadpool
        from starlette.middleware import Middleware
        from starlette.middleware.trustedhost import TrustedHostMiddleware
        from starlette.requests import Request
        from starlette.responses import JSONResponse, Response
        from starlette.routing import Mount, Route
        from starlette.staticfiles import StaticFiles
    except ImportError as error:
        raise ModelError(f'explore: {error.name} is missing; install it with: pip install "hbbogie[explore]"') from None

    def asks(answer: Callable[[Any], Any]) -> Callable[[Request], Any]:
        async def endpoint(request: Request) -> Response:
            status, content = await run_in_threadpool(_answered, answer, await request.body())
            return JSONResponse(content, status, HEADERS)

        return endpoint

    def ask(path: str, answer: Callable[[Any], Any]) -> Route:
        return Route(f"/api/{path}", asks(answer), methods=["POST"])

    class Page(StaticFiles):
        async def get_response(self, path: str, scope: Any) -> Response:
            response = await super().get_response(path, scope)
            response.headers.update(HEADERS)
            return response

    routes = [
        ask("opening", lambda _: session.opening()),
        ask("diagram", session.diagram),
        ask("cycle", session.cycle),
        ask("script", session.script),
        ask("report", session.report),
        Mount("/", Page(directory=PAGE, html=True)),
    ]
    guard = Middleware(TrustedHostMiddleware, allowed_hosts=[HERE, "localhost"])
    return Starlette(routes=routes, middleware=[guard])


def _answered(answer: Callable[[Any], Any], body: bytes) -> tuple[int, Any]:
    """Return the status and the answer to a question, or a sentence on what is wrong with it."""
    import json

    try:
        return 200, answer(json.loads(body or b"{}"))
    except Mistakes as error:
        return 422, {"error": str(error), "fields": error.fields}
    except FAILURES as error:
        return 422, {"error": str(error), "fields": {}}
    except Exception as error:  # a fault of this program: its trace is for the terminal, the page gets a sentence
        traceback.print_exc(file=sys.stderr)
        said = f"this could not be computed ({type(error).__name__}); the terminal shows where."
        return 500, {"error": said, "fields": {}}


def serve(
    session: Session, port: int = PORT, *, browser: bool = True, ready: Callable[[str], None] = lambda address: None
) -> None:
    """Serve the page of a session until Ctrl-C is pressed.

    Parameters
    ----------
    session : Session
    port : int
        On this machine; a free one is taken where it is 0.
    browser : bool
        Whether to open the page.
    ready : callable
        Called with the address once the page is there.

    Raises
    ------
    ModelError
        When the port is taken, or the extra that the server needs is not installed.
    """
    app = application(session)
    try:
        import uvicorn
    except ImportError as error:
        raise ModelError(f'explore: {error.name} is missing; install it with: pip install "hbbogie[explore]"') from None
    listening = _listening(port)
    config = uvicorn.Config(app, log_level="warning", access_log=False, timeout_graceful_shutdown=1)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    address = f"http://{HERE}:{listening.getsockname()[1]}/"
    with _until_pressed() as over:
        thread.start()
        ready(address)
        if browser:
            webbrowser.open(address)
        while thread.is_alive() and not over.wait(0.5):
            pass
        server.should_exit = True
        thread.join(2.0)
    listening.close()


@contextmanager
def _until_pressed() -> Iterator[threading.Event]:
    """Give an event that Ctrl-C sets, which is how a session ends and so no interruption."""
    over = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # where no signal arrives
        yield over
        return
    before = signal.signal(signal.SIGINT, lambda number, frame: over.set())
    try:
        yield over
    finally:
        signal.signal(signal.SIGINT, before)


def _listening(port: int) -> socket.socket:
    """Return a socket of this machine only that listens at a port."""
    if not 0 <= port <= 65535:
        raise ModelError(f"explore: port {port}; give a number from 0 (any free one) to 65535.")
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform != "win32":  # where it would let two servers share a port
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HERE, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise ModelError(
            f"explore: port {port} cannot be used ({error.strerror}); another program has it, perhaps another "
            "explorer. Give another with --port, or --port 0 for any free one."
        ) from error
    return listening
