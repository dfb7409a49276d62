"""`LiveReport`: the report on a run under way, served on this machine and made anew while the chains go on."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from http import HTTPStatus
from types import TracebackType
from typing import NamedTuple

from prf.output.report.page import report_document
from prf.results import RunData
from prf.shell.cli.server import LOOK, Answer, PageHandler, PageServer, Refused, running

logger = logging.getLogger(__name__)

EVERY = 3.0
"""Seconds between two pages at least."""
SHARE = 0.03
"""Of one processor that pages may take: one that is dear to make comes seldom."""
ABSENT = 15.0
"""Seconds after which a page that did not ask again is taken for closed; for such none is made."""
FAREWELL = 5.0
"""Seconds that the last page waits to be fetched at most."""


class Edition(NamedTuple):
    """A page as it is sent."""

    number: int
    document: bytes


class LiveReport:
    """Serves the report on a run; a context, in which `update` is called after every round.

    The page opens in a browser when there are draws to show. It asks for the next edition every two seconds and takes
    over its content, so that what was asked, zoomed and chosen stays. Making an edition takes a thread of its own.

    Parameters
    ----------
    browser : bool
        Open one; the address is printed on standard error in any case.
    """

    def __init__(self, browser: bool = True) -> None:
        self._browser = browser
        self._server: _EditionServer | None = None
        self._served = ExitStack()
        self._maker = ThreadPoolExecutor(1, "page")
        self._making: Future[None] | None = None
        self._due = 0.0

    def __enter__(self) -> LiveReport:
        """Return it; nothing is served before there is something to see."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, place: TracebackType | None
    ) -> None:
        """Stop serving."""
        self._maker.shutdown()
        self._served.close()

    def update(self, run_so_far: Callable[[], RunData]) -> None:
        """Have the next edition made, unless one is being made, it is too early, or nobody looks."""
        begun = time.monotonic()
        is_busy = self._making is not None and not self._making.done()
        if is_busy or begun < self._due or (self._server is not None and not self._server.is_watched()):
            return
        if self._making is not None and (error := self._making.exception()) is not None:
            logger.warning("the page of the run cannot be shown: %s", error)
            self._due = math.inf  # a run of hours does not end for its page
            return
        run = run_so_far()
        self._due = begun + EVERY
        if len(run.draws) and run.image is not None:
            self._making = self._maker.submit(self._make, run, time.monotonic() - begun)

    def finish(self, path: str) -> None:
        """Hand the page that was written of the whole run to the browser that shows an earlier one."""
        self._maker.shutdown()
        if self._server is None:
            return
        with open(path, "rb") as stream:
            self._server.publish(stream.read())
        until = time.monotonic() + FAREWELL
        while self._server.is_behind() and time.monotonic() < until:
            time.sleep(LOOK)

    def _make(self, run: RunData, taken: float) -> None:
        begun, cpu = time.monotonic(), time.thread_time()
        number = 1 if self._server is None else self._server.edition.number + 1
        text, _, policy = report_document(run, edition=number)
        if self._server is None:
            server = _EditionServer(policy, text.encode())
            self._served.enter_context(running(server, "page of the run", self._browser))
            self._server = server
        else:
            self._server.publish(text.encode())
        taken += time.thread_time() - cpu
        self._due = max(self._due, begun + taken / SHARE)
        logger.debug("page of the run: %.2f s", taken)


class _EditionServer(PageServer):
    """Has the latest edition."""

    def __init__(self, policy: str, document: bytes) -> None:
        self.edition = Edition(1, document)
        self.given = 0  # number of the edition that was sent last
        self.asked = time.monotonic()
        super().__init__(_EditionHandler, policy)

    def publish(self, document: bytes) -> None:
        """Put an edition in the place of the one before."""
        self.edition = Edition(self.edition.number + 1, document)

    def is_watched(self) -> bool:
        """Return whether a page has asked of late, or may yet be opened."""
        return time.monotonic() - self.asked < ABSENT

    def is_behind(self) -> bool:
        """Return whether a page will ask for an edition that it does not have."""
        return self.is_watched() and self.given != self.edition.number


class _EditionHandler(PageHandler):
    """Answers one connection."""

    server: _EditionServer

    def answer(self, path: str) -> Answer:
        """Return the latest edition, or nothing where the page has it."""
        edition = self.server.edition
        if self.command != "GET" or not (path == "/" or path.startswith("/after/")):
            raise Refused(HTTPStatus.NOT_FOUND)
        self.server.asked, self.number = time.monotonic(), edition.number
        if path == f"/after/{edition.number}":
            return HTTPStatus.NO_CONTENT, "text/html", b""
        return HTTPStatus.OK, "text/html; charset=utf-8", edition.document

    def send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        """Send an answer and note which edition it was."""
        super().send(status, kind, body)
        if body.startswith(b"<!DOCTYPE"):
            self.server.given = self.number
