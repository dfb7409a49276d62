"""Addresses at which there is no scheduler, or none that can be used: one line, soon, and nothing from Dask itself."""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest

import prf.shell.scheduler as scheduler
from prf.shell.errors import ConfigError, InputError

OTHERS = {
    "ssh": b"SSH-2.0-OpenSSH_9.2p1\r\n",
    "web": b"HTTP/1.0 400 Bad request\r\n\r\n" + b"x" * 4000,
    "ones": b"\xff" * 64,
    "zeros": bytes(640),
    "half a message": bytes([16, *bytes(7), 1]) + bytes(120),
    "nothing at all": b"",
}


@contextlib.contextmanager
def answering(said: bytes) -> Iterator[str]:
    """Give the address of a server that says the same to everybody, or keeps silent."""
    taken = []

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                taken.append(server.accept()[0])
                taken[-1].sendall(said)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)
        thread.join()
    for each in taken:
        each.close()


@pytest.fixture
def dask(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(scheduler, "CONNECT_SECONDS", 0.2)
    return pytest.importorskip("distributed")


def version() -> str:
    return "1.0"


def refused(address: str) -> str:
    with pytest.raises(InputError) as caught:
        scheduler.Cluster(address, "prf", version)
    assert str(caught.value).startswith(f"--scheduler {address}: ")
    return str(caught.value)


@pytest.mark.parametrize("name", OTHERS)
def test_something_else_that_answers_is_no_scheduler(
    name: str, dask: Any, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Dask's client, made with such an address, waits for half a minute as Python ends, and shows a traceback."""
    monkeypatch.setattr(dask, "Client", lambda *_, **__: pytest.fail("a client was made"))
    with answering(OTHERS[name]) as address:
        assert refused(address).endswith("no scheduler answers there. Start one: dask scheduler.")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x", "a:b:c", ""])
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
    monkeypatch.setattr(scheduler, "_client", lambda *_: client)
    with pytest.raises(ConfigError, match=words):
        scheduler.Cluster("tcp://there:1", "prf", version)
    assert not client.is_open


def test_dask_is_silent_until_the_client_is_closed(dask: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would show tracebacks of its own when a scheduler is lost."""
    client = FakeClient({"a": "1.0"})
    monkeypatch.setattr(scheduler, "_client", lambda *_: client)
    logger = logging.getLogger("distributed.client")
    before = logger.level
    cluster = scheduler.Cluster("tcp://there:1", "prf", version)
    assert client.is_open
    assert not logger.isEnabledFor(logging.CRITICAL)
    cluster.close()
    assert not client.is_open
    assert logger.level == before
