"""The server of the labelling page: this machine alone, one token, one writer."""

from __future__ import annotations

import hmac
import json
import logging
import secrets
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from mapq.io.journal import WORDS
from mapq.labelling.page import Page
from prf.shell.cli.storage import jsonable
from prf.shell.errors import PrfError, UsageError, system_reason

logger = logging.getLogger(__name__)

HOST = "127.0.0.1"
TOKEN_HEADER = "X-Mapq-Token"
LARGEST_BODY = 4096
"""Bytes of a request: a label is less than a hundred."""
PATIENCE = 60.0
"""Seconds for which a connection may stay silent."""

HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class _Refused(Exception):  # noqa: N818 - what happens to a request
    """A request that is answered with a status and nothing else."""

    def __init__(self, status: HTTPStatus, words: str = "") -> None:
        super().__init__(words or status.phrase)
        self.status = status


class LabelServer(ThreadingHTTPServer):
    """Serves one page on 127.0.0.1.

    Parameters
    ----------
    page : Page
    port : int
        0 takes a free one.

    Attributes
    ----------
    done : threading.Event
        Set when the person ends labelling.
    """

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, page: Page, port: int = 0) -> None:
        self.page = page
        self.token = secrets.token_urlsafe(32)
        self.done = threading.Event()
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise UsageError(
                f"port {port} cannot be used ({system_reason(error)}). Give another --port, or none."
            ) from error

    @property
    def url(self) -> str:
        """Where the page is, token included."""
        return f"http://{HOST}:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log browsers that hang up, in the details alone."""
        logger.debug("a connection was closed early", exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    server: LabelServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "mapq", ""
    timeout = PATIENCE
    is_last = False

    def handle_any(self) -> None:
        """Answer a request of whatever method."""
        try:
            parts = urlsplit(self.path)
            self._check_sender(parts.query)
            status, kind, body = self._answer(parts.path)
        except _Refused as refused:
            # A body that was not read would be taken for the next request.
            self.close_connection = True
            status, kind, body = refused.status, "text/plain", f"{refused}\n".encode()
        except PrfError as error:
            status, kind = HTTPStatus.INTERNAL_SERVER_ERROR, "application/json"
            body = json.dumps({"error": str(error)}).encode()
        except OSError:  # the browser hung up
            raise
        except Exception as error:
            logger.warning("internal error: %s: %s", type(error).__name__, error, exc_info=True)
            status, kind = HTTPStatus.INTERNAL_SERVER_ERROR, "application/json"
            body = json.dumps({"error": "internal error; see where mapq was started"}).encode()
        try:
            self._send(status, kind, body)
        finally:
            if self.is_last:  # not before the answer went out: mapq ends at once, and the page would wait for the rest
                self.server.done.set()

    do_GET = do_POST = do_HEAD = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = handle_any  # noqa: N815 - their names

    def _check_sender(self, query: str) -> None:
        """Refuse whoever is not the page that this server sent to the person who has the token.

        Another host name means DNS rebinding, another origin a page of somebody else's.
        """
        hosts = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
        hosts_given, origins = self.headers.get_all("Host", []), self.headers.get_all("Origin", [])
        if len(hosts_given) != 1 or hosts_given[0] not in hosts:
            raise _Refused(HTTPStatus.FORBIDDEN)
        if any(origin != f"http://{hosts_given[0]}" for origin in origins):
            raise _Refused(HTTPStatus.FORBIDDEN)
        path = urlsplit(self.path).path
        given = (parse_qs(query).get("token", [""])[0]) if path == "/" else self.headers.get(TOKEN_HEADER, "")
        if not hmac.compare_digest(given.encode(), self.server.token.encode()):
            raise _Refused(HTTPStatus.FORBIDDEN)

    def _answer(self, path: str) -> tuple[HTTPStatus, str, bytes]:
        page = self.server.page
        if self.command == "GET" and path == "/":
            return HTTPStatus.OK, "text/html; charset=utf-8", page.document()
        if self.command == "GET" and path == "/api/state":
            return self._object(page.state)
        if self.command == "GET" and path.startswith("/api/patch/"):
            return self._object(lambda: page.patch(self._number(path.removeprefix("/api/patch/"))))
        if self.command == "POST" and path == "/api/label":
            given = self._body()
            word = given.get("label")
            if not isinstance(word, str) or word not in WORDS:
                raise _Refused(HTTPStatus.BAD_REQUEST, "no such label")
            return self._object(lambda: page.label(self._number(given.get("patch")), WORDS[word]))
        if self.command == "POST" and path == "/api/undo":
            self._body()
            return self._object(page.undo)
        if self.command == "POST" and path == "/api/finish":
            self._body()
            return self._object(self._finish)
        known = path == "/" or path.startswith("/api/")
        raise _Refused(HTTPStatus.METHOD_NOT_ALLOWED if known else HTTPStatus.NOT_FOUND)

    def _finish(self) -> dict[str, Any]:
        self.is_last = True
        return {"done": True}

    def _number(self, given: Any) -> int:
        """Return the number of a patch that there is."""
        text = str(given)
        if isinstance(given, bool) or not text.isascii() or not text.isdigit() or len(text) > 9:
            raise _Refused(HTTPStatus.NOT_FOUND, "no such patch")
        if int(text) >= self.server.page.n_patches:
            raise _Refused(HTTPStatus.NOT_FOUND, "no such patch")
        return int(text)

    def _body(self) -> dict[str, Any]:
        """Return the JSON object of a request; browsers of other pages cannot send this type without being asked."""
        length, kind = self.headers.get("Content-Length", ""), self.headers.get("Content-Type", "")
        if kind.partition(";")[0].strip() != "application/json":
            raise _Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE)
        if not (length.isascii() and length.isdigit() and int(length) <= LARGEST_BODY):
            raise _Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        try:
            found = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise _Refused(HTTPStatus.BAD_REQUEST, "expected a JSON object")
        return found

    def _object(self, make: Callable[[], dict[str, Any]]) -> tuple[HTTPStatus, str, bytes]:
        return HTTPStatus.OK, "application/json", json.dumps(jsonable(make()), allow_nan=False).encode()

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Security-Policy", self.server.page.policy)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Log requests in the details alone, and never a token."""
        logger.debug("%s %s", self.command, urlsplit(self.path).path if hasattr(self, "path") else "")
