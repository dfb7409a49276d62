"""The report on a run under way: served to whoever has the address, new after a while, complete at the end."""

from __future__ import annotations

import re
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path

import pytest

from prf.output.report import LiveReport, live, write_report
from tests.factories import make_run
from tests.output.report.test_page import slow_run


@pytest.fixture
def report(monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveReport]:
    monkeypatch.setattr(live, "EVERY", 0.0)
    monkeypatch.setattr(live, "SHARE", float("inf"))
    with LiveReport(browser=False) as report:
        yield report


def made(report: LiveReport) -> None:
    """Have an edition made, and wait for it."""
    report.update(slow_run)
    assert report._making is not None
    report._making.result()


def address_in(words: str) -> str:
    found = re.search(r"page of the run: (http://127\.0\.0\.1:\d+/\?token=\S+)\n", words)
    assert found is not None, words
    return found[1]


def get(address: str, path: str = "/", token: str | None = None, method: str = "GET") -> tuple[int, str]:
    """Return status and body of a request, with the token of the address or another."""
    _, place, own = re.split(r"//|/\?token=", address)
    connection = HTTPConnection(place, timeout=20)
    secret = own if token is None else token
    connection.request(method, f"/?token={secret}" if path == "/" else path, headers={"X-Page-Token": secret})
    answer = connection.getresponse()
    body = answer.read().decode()
    connection.close()
    return answer.status, body


def test_a_page_is_served_once_there_are_draws_and_has_what_the_run_has_so_far(report, capsys) -> None:
    report.update(lambda: make_run(n_draws=0))
    assert "page of the run" not in capsys.readouterr().err
    made(report)
    address = address_in(capsys.readouterr().err)
    status, first = get(address)
    assert status == 200
    assert "Under way: " in first
    assert "connect-src 'self'" in first
    assert get(address, "/after/1") == (204, "")
    made(report)
    assert get(address, "/after/1")[0] == 200
    assert get(address, "/after/2")[0] == 204
    assert get(address, token="wrong")[0] == get(address, "/after/1", token="")[0] == 403
    assert get(address, method="POST")[0] == get(address, "/other")[0] == 404


def test_the_last_page_is_the_file_and_nothing_answers_after_it(report, capsys, tmp_path: Path) -> None:
    made(report)
    address = address_in(capsys.readouterr().err)
    write_report(str(tmp_path / "run.html"), slow_run())
    assert report._server is not None
    report._server.asked -= live.ABSENT  # nobody looks: none waits
    report.finish(str(tmp_path / "run.html"))
    assert get(address, "/after/1") == (200, (tmp_path / "run.html").read_text())
    report.__exit__(None, None, None)
    with pytest.raises(ConnectionRefusedError):
        get(address)


def test_nothing_is_made_for_nobody(report) -> None:
    made(report)
    assert report._server is not None
    report._server.asked -= live.ABSENT
    report.update(lambda: pytest.fail("no page is open"))


def test_a_page_that_cannot_be_made_ends_no_run(report, monkeypatch, caplog) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError("no sockets left")

    monkeypatch.setattr(live, "report_document", fail)
    with pytest.raises(OSError, match="no sockets"):
        made(report)
    monkeypatch.setattr(live.logger, "propagate", True)
    for _ in range(3):
        report.update(slow_run)
    assert [record.getMessage() for record in caplog.records if "page of the run cannot" in record.getMessage()] == [
        "the page of the run cannot be shown: no sockets left"
    ]
