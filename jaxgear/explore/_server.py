"""The explorer's server: one page and its questions, for who knows the token, on this computer."""

import functools
import http.server
import json
import secrets
import threading
import urllib.parse
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from jaxgear._checks import InputError
from jaxgear.explore._answers import PageAnswers
from jaxgear.study._live import LiveScene
from jaxgear.study._running import stopwatch
from jaxgear.study._statics import SolverFailure

_HOST = "127.0.0.1"
# A question has a few dozen numbers [byte].
_LONGEST = 65_536
# How long a browser may take over a question that it has begun [s].
_PATIENCE = 10.0


class Explorer:
    """A scene in a browser's window.

    It listens on the loopback address only, and answers who knows its token, under its own name:
    other pages in the same browser learn nothing.
    """

    def __init__(self, live: LiveScene, target: Path, port: int = 0):
        """Begin to listen.

        **Arguments:**

        - `live`: the scene.
        - `target`: the file into which the page writes the scene.
        - `port`: to listen on; a free one without it.

        **Raises:**

        - `OSError` if the port is taken.
        """
        token = secrets.token_urlsafe(24)
        questions = PageAnswers(live, target).by_name
        self._lock = threading.Lock()
        handler = functools.partial(_Handler, token, questions, self._lock)
        self._server = http.server.ThreadingHTTPServer((_HOST, port), handler)
        self._server.daemon_threads = True
        self.address = f"http://{_HOST}:{self._server.server_address[1]}/?token={token}"

    def serve(self) -> None:
        """Answer until `stop`, or until interrupted."""
        try:
            self._server.serve_forever(poll_interval=0.1)
        finally:
            self._server.server_close()

    def is_idle(self, patience: float) -> bool:
        """Whether no question is being answered, or none any more after so long [s]."""
        idle = self._lock.acquire(timeout=patience)
        if idle:
            self._lock.release()
        return idle

    def stop(self) -> None:
        """End `serve`, from another thread."""
        self._server.shutdown()


class _Handler(http.server.BaseHTTPRequestHandler):
    """One request."""

    protocol_version = "HTTP/1.1"
    server_version = "jaxgear"
    sys_version = ""
    timeout = _PATIENCE
    # Head and body go one after the other: the body would wait 40 ms for the head's receipt.
    disable_nagle_algorithm = True

    def __init__(
        self,
        token: str,
        questions: Mapping[str, Callable[[Mapping[str, Any]], Mapping[str, Any]]],
        one_at_a_time: threading.Lock,
        *connection: Any,
    ):
        """Handle a connection; programs are asked one at a time."""
        self._token, self._questions, self._lock = token, questions, one_at_a_time
        super().__init__(*connection)

    def do_GET(self) -> None:
        """The page."""
        url = urllib.parse.urlsplit(self.path)
        given = urllib.parse.parse_qs(url.query).get("token", [""])[0]
        if not self._is_known(given):
            return
        if url.path != "/" or url.netloc:
            self._refuse(404, "There is only one page here, /.")
            return
        self._send(200, "text/html; charset=utf-8", _page().encode())

    def do_POST(self) -> None:
        """A question of the page."""
        if not self._is_known(self.headers.get("X-Token", "")):
            return
        question = self._questions.get(self.path.removeprefix("/"))
        if question is None:
            self._refuse(404, "No such question.")
            return
        try:
            length = int(self.headers.get("Content-Length", ""))
        except ValueError:
            length = -1
        if not 0 <= length <= _LONGEST:
            self._refuse(413, f"A question has a length, of at most {_LONGEST} bytes.")
            return
        try:
            asked = json.loads(self.rfile.read(length) or b"{}")
            if not isinstance(asked, dict):
                raise InputError("A question must be a table.")
            with self._lock, stopwatch():
                found = question(asked)
            self._send_json(200, found)
        except (ValueError, SolverFailure, ArithmeticError) as error:
            self._refuse(422, str(error))
        except RecursionError:
            self._refuse(422, "The question is nested too deeply.")
        except TimeoutError:
            self._refuse(408, "The question has not come whole.")
        except OSError as error:
            self._refuse(500, f"cannot write the scene: {error.strerror}")

    def _is_known(self, token: str) -> bool:
        """Whether a request is of our page; it is refused if not."""
        port = self.connection.getsockname()[1]
        names = (f"{_HOST}:{port}", f"localhost:{port}")
        # Another name that leads here is how a foreign page would ask.
        if self.headers.get_all("Host", []) not in [[name] for name in names]:
            self._refuse(403, "This host is not known here.")
        elif not secrets.compare_digest(token.encode(), self._token.encode()):
            self._refuse(403, "The token is missing or wrong: open the address that was printed.")
        else:
            return True
        return False

    def _refuse(self, code: int, why: str) -> None:
        # What of the request has not been read would be taken for the next one.
        self.close_connection = True
        self._send_json(code, {"error": why})

    def _send_json(self, code: int, found: Mapping[str, Any]) -> None:
        text = json.dumps(found, default=lambda array: array.tolist())
        self._send(code, "application/json", text.encode())

    def _send(self, code: int, kind: str, content: bytes) -> None:
        self.send_response(code)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; "
            "style-src 'unsafe-inline'; connect-src 'self'; img-src data:; frame-ancestors 'none'",
        }.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the window says what goes wrong."""


@functools.cache
def _page() -> str:
    """The page with its style and script in it."""
    page, style, script = (
        resources.files("jaxgear.explore").joinpath(name).read_text(encoding="utf-8")
        for name in ("page.html", "page.css", "page.js")
    )
    return page.replace("/* style */", style).replace("/* script */", script)
