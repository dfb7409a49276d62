"""A labelling page that runs in this process, and requests of all kinds to it."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mapq.labelling.page import Page
from mapq.labelling.server import LabelServer
from mapq.labelling.store import Store, open_store
from mapq.results.result import assess
from tests.mapq.results.test_result import make_model


@contextmanager
def serving(path: str, with_model: bool = True) -> Iterator[tuple[LabelServer, Store]]:
    with open_store(str(path)) as store:
        server = LabelServer(Page(store, assess(store.patches, make_model()) if with_model else None))
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        thread.start()
        try:
            yield server, store
        finally:
            server.shutdown()
            server.server_close()
            thread.join()


def ask(server: LabelServer, method: str, path: str, body: Any = None, **headers: str | None) -> tuple[int, Any, Any]:
    """Return status, headers and body of a request that has the token, but for headers given (None: left out)."""
    sent: dict[str, str | None] = {"X-Page-Token": server.token}
    if body is not None:
        sent["Content-Type"] = "application/json"
    sent |= {name.replace("_", "-"): value for name, value in headers.items()}
    data = body if isinstance(body, bytes) else None if body is None else json.dumps(body).encode()
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=20)
    connection.request(method, path, data, {name: value for name, value in sent.items() if value is not None})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    is_json = answer.getheader("Content-Type") == "application/json"
    return answer.status, answer.headers, json.loads(content) if is_json else content
