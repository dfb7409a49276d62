"""A page served to this machine alone, to whoever has its token; the verbs of both tools say what it answers."""

from __future__ import annotations

import hmac
import json
import logging
import os
import secrets
import socket
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from prf.shell.errors import PrfError, UsageError, system_reason

logger = logging.getLogger(__name__)

HOST = "127.0.0.1"
TOKEN_HEADER = "X-Page-Token"
PATIENCE = 60.0
"""Seconds for which a connection may stay silent."""
LOOK = 0.2
"""Seconds between two looks at whether to end."""

HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}

Answer = tuple[HTTPStatus, str, bytes]
"""Status, type and body."""


class Refused(Exception):  # noqa: N818 - what happens to a request
    """A request that is answered with a status and nothing else."""

    def __init__(self, status: HTTPStatus, words: str = "") -> None:
        super().__init__(words or status.phrase)
        self.status = status


class PageServer(ThreadingHTTPServer):
    """Serves one page on 127.0.0.1.

    Parameters
    ----------
    handler : type
        What answers requests.
    policy : str
        Content security policy of the page.
    port : int
        0 takes a free one.
    """

    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, handler: type[PageHandler], policy: str, port: int = 0) -> None:
        self.policy = policy
        self.token = secrets.token_urlsafe(32)
        try:
            super().__init__((HOST, port), handler)
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


class PageHandler(BaseHTTPRequestHandler):
    """Answers one connection."""

    server: PageServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "page", ""
    timeout = PATIENCE

    def answer(self, path: str) -> Answer:
        """Return the answer to a request of the page; :class:`Refused` where there is none, as here for all."""
        raise Refused(HTTPStatus.NOT_FOUND)

    def handle_any(self) -> None:
        """Answer a request of whatever method."""
        try:
            parts = urlsplit(self.path)
            self._check_sender(parts.query)
            status, kind, body = self.answer(parts.path)
        except Refused as refused:
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
            body = json.dumps({"error": "internal error; see where the page was started"}).encode()
        self.send(status, kind, body)

    do_GET = do_POST = do_HEAD = do_PUT = do_PATCH = do_DELETE = do_OPTIONS = handle_any  # noqa: N815 - their names

    def _check_sender(self, query: str) -> None:
        """Refuse whoever is not the page that this server sent to the person who has the token.

        Another host name means DNS rebinding, another origin a page of somebody else's.
        """
        hosts = {f"{name}:{self.server.server_port}" for name in (HOST, "localhost")}
        hosts_given, origins = self.headers.get_all("Host", []), self.headers.get_all("Origin", [])
        if len(hosts_given) != 1 or hosts_given[0] not in hosts:
            raise Refused(HTTPStatus.FORBIDDEN)
        if any(origin != f"http://{hosts_given[0]}" for origin in origins):
            raise Refused(HTTPStatus.FORBIDDEN)
        path = urlsplit(self.path).path
        given = (parse_qs(query).get("token", [""])[0]) if path == "/" else self.headers.get(TOKEN_HEADER, "")
        if not hmac.compare_digest(given.encode(), self.server.token.encode()):
            raise Refused(HTTPStatus.FORBIDDEN)

    def send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        """Send an answer, with the headers that keep pages of others away."""
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if status != HTTPStatus.NO_CONTENT:
            self.send_header("Content-Length", str(len(body)))
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Security-Policy", self.server.policy)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Log requests in the details alone, and never a token."""
        logger.debug("%s %s", self.command, urlsplit(self.path).path if hasattr(self, "path") else "")


@contextmanager
def running(server: PageServer, words: str, browser: bool = True) -> Iterator[None]:
    """Answer requests as long as the block lasts; print the address after `words`, and open the page in a `browser`."""
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": LOOK}, daemon=True)
    thread.start()
    # The address is the result of starting, so that even -q shows it.
    sys.stderr.write(f"{words}: {server.url}{_way_there(server.server_port)}\n")  # at once: other threads write too
    try:
        with _shown(server.url, browser):
            yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def _way_there(port: int) -> str:
    """Return in words how a person at another machine reaches the page; empty for one at this machine."""
    if not os.environ.get("SSH_CONNECTION"):
        return ""
    return f"\nfrom your own machine, first: ssh -N -L {port}:{HOST}:{port} {socket.gethostname()}"


@contextmanager
def _shown(url: str, browser: bool) -> Iterator[None]:
    """Open the page by way of a file that only this user can read: command lines are there for all to see."""
    if not browser:
        yield
        return
    with tempfile.TemporaryDirectory(prefix="page-") as folder:
        file = os.path.join(folder, "open.html")
        with open(file, "w", encoding="utf-8", opener=lambda name, flags: os.open(name, flags, 0o600)) as stream:
            stream.write(f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={escape(url, quote=True)}">')
        _open(f"file://{file}")
        yield


def _open(url: str) -> None:
    """Open a page in a browser with windows; one in the terminal would take it over, and shows no map."""
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return
    if type(browser) is not webbrowser.GenericBrowser:
        browser.open(url)
