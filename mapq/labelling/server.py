"""The server of the labelling page: this machine alone, one token, one writer."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

from mapq.io.journal import WORDS
from mapq.labelling.page import Page
from prf.shell.cli.server import Answer, PageHandler, PageServer, Refused
from prf.shell.cli.storage import jsonable

LARGEST_BODY = 4096
"""Bytes of a request: a label is less than a hundred."""


class LabelServer(PageServer):
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

    def __init__(self, page: Page, port: int = 0) -> None:
        self.page = page
        self.done = threading.Event()
        super().__init__(_Handler, page.policy, port)


class _Handler(PageHandler):
    """Answers one connection."""

    server: LabelServer
    is_last = False

    def send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        """Send an answer; the last one ends labelling."""
        try:
            super().send(status, kind, body)
        finally:
            if self.is_last:  # not before the answer went out: mapq ends at once, and the page would wait for the rest
                self.server.done.set()

    def answer(self, path: str) -> Answer:
        """Return the page, or what an action on it comes to."""
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
                raise Refused(HTTPStatus.BAD_REQUEST, "no such label")
            return self._object(lambda: page.label(self._number(given.get("patch")), WORDS[word]))
        if self.command == "POST" and path == "/api/undo":
            self._body()
            return self._object(page.undo)
        if self.command == "POST" and path == "/api/finish":
            self._body()
            return self._object(self._finish)
        known = path == "/" or path.startswith("/api/")
        raise Refused(HTTPStatus.METHOD_NOT_ALLOWED if known else HTTPStatus.NOT_FOUND)

    def _finish(self) -> dict[str, Any]:
        self.is_last = True
        return {"done": True}

    def _number(self, given: Any) -> int:
        """Return the number of a patch that there is."""
        text = str(given)
        if isinstance(given, bool) or not text.isascii() or not text.isdigit() or len(text) > 9:
            raise Refused(HTTPStatus.NOT_FOUND, "no such patch")
        if int(text) >= self.server.page.n_patches:
            raise Refused(HTTPStatus.NOT_FOUND, "no such patch")
        return int(text)

    def _body(self) -> dict[str, Any]:
        """Return the JSON object of a request; browsers of other pages cannot send this type without being asked."""
        length, kind = self.headers.get("Content-Length", ""), self.headers.get("Content-Type", "")
        if kind.partition(";")[0].strip() != "application/json":
            raise Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE)
        if not (length.isascii() and length.isdigit() and int(length) <= LARGEST_BODY):
            raise Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        try:
            found = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            found = None
        if not isinstance(found, dict):
            raise Refused(HTTPStatus.BAD_REQUEST, "expected a JSON object")
        return found

    def _object(self, make: Callable[[], dict[str, Any]]) -> Answer:
        return HTTPStatus.OK, "application/json", json.dumps(jsonable(make()), allow_nan=False).encode()
