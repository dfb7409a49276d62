"""Addresses at which there is no scheduler, or none that can be used: one line, soon, and nothing from Dask itself."""

from __future__ import annotations

import logging
from typing import Any

import pytest

import prf.shell.scheduler as scheduler
from prf.shell.errors import ConfigError, InputError


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(scheduler, "CONNECT_SECONDS", 0.2)
    return pytest.importorskip("distributed")


def version() -> str:
    return "1.0"


def refused(address: str) -> str:
    with pytest.raises(InputError) as caught, scheduler.open_client(address, "prf", version):
        pytest.fail("entered the block")
    assert str(caught.value).startswith(f"--scheduler {address}: ")
    return str(caught.value)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_addresses_where_nobody_answers(address: str, dask: Any, capfd: pytest.CaptureFixture[str]) -> None:
    refused(address)
    assert capfd.readouterr() == ("", "")


class FakeClient:
    def __init__(self, found: Any) -> None:
        self.found, self.is_open = found, True

    def run(self, _function: Any) -> Any:
        if isinstance(self.found, Exception):
            raise self.found
        return self.found

    def close(self) -> None:
        self.is_open = False


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({}, "it has no workers. Start workers with prf 1.0"),
        ({"a": "1.0", "b": "0.9"}, "its workers have prf 0.9, 1.0."),
        (ModuleNotFoundError("prf"), "its workers cannot import prf 1.0. Install it."),
    ],
)
def test_workers_that_cannot_be_used(found: Any, words: str, dask: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    client = FakeClient(found)
    monkeypatch.setattr(dask, "Client", lambda *_, **__: client)
    with pytest.raises(ConfigError, match=words), scheduler.open_client("tcp://there:1", "prf", version):
        pytest.fail("entered the block")
    assert not client.is_open


def test_dask_is_silent_until_the_client_is_closed(dask: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would show tracebacks of its own when a scheduler is lost."""
    client = FakeClient({"a": "1.0"})
    monkeypatch.setattr(dask, "Client", lambda *_, **__: client)
    logger = logging.getLogger("distributed.client")
    before = logger.level
    with scheduler.open_client("tcp://there:1", "prf", version):
        assert client.is_open
        assert not logger.isEnabledFor(logging.CRITICAL)
    assert not client.is_open
    assert logger.level == before
