from __future__ import annotations

import socket

import numpy as np
import pytest

from mapq.io import read_patches, write_patches
from mapq.io.journal import journal_beside
from mapq.labelling.page import Page
from mapq.labelling.server import LabelServer
from mapq.labelling.store import open_store
from mapq.labels import PLAUSIBLE, UNLABELLED
from prf.shell.cli.server import PageHandler
from prf.shell.errors import UsageError
from tests.mapq.labelled import draw_patches
from tests.mapq.labelling.pages import ask, serving

LABEL = {"patch": 3, "label": "suspicious"}
REQUESTS = [
    ("GET", "/api/state", None),
    ("GET", "/api/patch/0", None),
    ("POST", "/api/label", LABEL),
    ("POST", "/api/undo", {}),
    ("POST", "/api/finish", {}),
]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("served") / "a.patches"
    write_patches(path, draw_patches(1, labelled=False))
    return path


@pytest.fixture(scope="module")
def served(path):
    with serving(path) as pair:
        yield pair


def strangers(server):
    """Return headers of requests that are none of the page's."""
    port = server.server_port
    return [
        {"X_Page_Token": None},
        {"X_Page_Token": ""},
        {"X_Page_Token": server.token[:-1]},
        {"X_Page_Token": server.token + "x"},
        {"X_Page_Token": "ü"},
        {"Host": "evil.example"},
        {"Host": f"evil.example:{port}"},
        {"Host": "127.0.0.1"},
        {"Host": f"127.0.0.1:{port + 1}"},
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Origin": f"http://127.0.0.1:{port + 1}"},
        {"Origin": f"https://127.0.0.1:{port}"},
        {"Origin": f"http://localhost:{port}"},
    ]


@pytest.mark.parametrize(("method", "where", "body"), REQUESTS)
def test_strangers_read_nothing_and_write_nothing(served, path, method, where, body):
    server, store = served
    for headers in strangers(server):
        sent = {name: value.encode().decode("latin1") if value else value for name, value in headers.items()}
        status, answered, content = ask(server, method, where, body, **sent)
        assert (status, content) == (403, b"Forbidden\n"), headers
        assert not [name for name in answered if name.lower().startswith("access-control-")]
    assert store.counts()["n_by_hand"] == 0
    assert not journal_beside(path).exists()
    assert not server.done.is_set()


@pytest.mark.parametrize("where", ["/", "/?token=", "/?token=wrong", "/index.html", "/api/state?token={token}"])
def test_the_page_itself_needs_the_token_and_the_rest_its_header(served, where):
    server, _ = served
    assert ask(server, "GET", where.format(token=server.token), X_Page_Token=None)[0] == 403


def test_other_hosts_and_origins_do_not_get_the_page(served):
    server, _ = served
    for headers in ({"Host": "evil.example"}, {"Origin": "https://evil.example"}):
        assert ask(server, "GET", f"/?token={server.token}", **headers)[0] == 403


def test_the_page_comes_with_rules_of_its_own(served):
    server, _ = served
    status, headers, content = ask(server, "GET", f"/?token={server.token}", X_Page_Token=None)
    assert status == 200
    assert b"<title>Labelling a.patches</title>" in content
    policy = headers["Content-Security-Policy"]
    for rule in ("default-src 'none'", "connect-src 'self'", "frame-ancestors 'none'", "form-action 'none'"):
        assert rule in policy
    assert "unsafe-inline'" not in policy.partition("style-src")[0]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store"
    assert "Python" not in headers["Server"]


@pytest.mark.parametrize("method", ["OPTIONS", "PUT", "DELETE", "PATCH", "HEAD"])
def test_no_other_method_does_anything(served, method):
    server, _ = served
    assert ask(server, method, "/api/label", X_Page_Token=None)[0] == 403
    status, headers, _ = ask(server, method, "/api/label")
    assert status == 405
    assert "Access-Control-Allow-Origin" not in headers


@pytest.mark.parametrize(
    ("where", "body", "status"),
    [
        ("/api/label", {"patch": 32, "label": "plausible"}, 404),
        ("/api/label", {"patch": -1, "label": "plausible"}, 404),
        ("/api/label", {"patch": True, "label": "plausible"}, 404),
        ("/api/label", {"patch": 1.5, "label": "plausible"}, 404),
        ("/api/label", {"patch": "²", "label": "plausible"}, 404),
        ("/api/label", {"patch": 1, "label": "odd"}, 400),
        ("/api/label", {"patch": 1, "label": ["plausible"]}, 400),
        ("/api/label", [], 400),
        ("/api/label", b"{", 400),
        ("/api/label", b'{"patch": 1, "label": "plausible"}' + b" " * 5000, 413),
        ("/api/nothing", {}, 405),
        ("/nothing", {}, 404),
    ],
)
def test_what_makes_no_sense_is_refused_and_changes_nothing(served, where, body, status):
    server, store = served
    assert ask(server, "POST", where, body)[0] == status
    assert store.counts()["n_by_hand"] == 0


def test_a_form_of_another_page_could_not_send_this(served):
    server, _ = served
    assert ask(server, "POST", "/api/label", LABEL, Content_Type="text/plain")[0] == 415


@pytest.mark.parametrize("number", ["99", "-1", "x", "1.0", "", "../state", "00000000000000000000"])
def test_patches_that_there_are_not(served, number):
    server, _ = served
    assert ask(server, "GET", f"/api/patch/{number}")[0] == 404


def test_a_patch_with_neighbours_measures_and_reasons(served):
    server, _ = served
    status, _, found = ask(server, "GET", "/api/patch/5")
    assert status == 200
    assert found["patch"] == 5
    assert found["measures"]["area_m2"] > 20.0
    assert found["scene"]["m"] == 1 + len(found["neighbours"])
    assert found["scene"]["k"] > 0
    assert any("parallel to patch" in text for text, _, _ in found["reasons"])
    assert all(row["text"] for row in found["neighbours"])


def test_the_order_is_that_of_doubt(served):
    server, _ = served
    state = ask(server, "GET", "/api/state")[2]
    assert sorted(state["order"]) == list(range(32))
    p = [ask(server, "GET", f"/api/patch/{patch}")[2]["p"] for patch in state["order"][:6]]
    doubt = np.abs(np.array(p) - 0.5)
    assert (np.diff(doubt) >= 0.0).all()


def test_labels_are_taken_and_taken_back(tmp_path):
    path = tmp_path / "a.patches"
    write_patches(path, draw_patches(1, labelled=False))
    with serving(path) as (server, store):
        assert ask(server, "POST", "/api/label", LABEL)[2]["counts"]["n_suspicious"] == 1
        assert ask(server, "POST", "/api/label", {"patch": 4, "label": "unsure"})[2]["said"] == UNLABELLED
        assert read_patches(path).label[3] == 1, "on the disk as soon as it is answered"
        answer = ask(server, "POST", "/api/undo", {})[2]
        assert (answer["patch"], answer["said"], answer["can_undo"]) == (4, 254, True)
        assert ask(server, "GET", "/api/state")[2]["said"][3] == 1
        assert ask(server, "POST", "/api/finish", {})[0] == 200
        assert server.done.wait(60.0)
        store.merge()
        status, _, content = ask(server, "POST", "/api/label", LABEL)
        assert (status, "has ended" in content["error"]) == (500, True)
    assert read_patches(path).label[3] == 1


def test_it_is_over_when_the_page_has_its_answer_and_not_before(tmp_path, monkeypatch):
    path = tmp_path / "a.patches"
    write_patches(path, draw_patches(1, labelled=False))
    with serving(path) as (server, _):
        sent = []

        def send(handler, *answer):
            sent.append(server.done.is_set())
            original(handler, *answer)

        original = PageHandler.send
        monkeypatch.setattr(PageHandler, "send", send)
        assert ask(server, "POST", "/api/finish", {})[0] == 200
        assert server.done.wait(60.0)
        assert sent == [False]


def test_a_label_that_cannot_be_stored_is_an_error_on_the_page(tmp_path, monkeypatch):
    path = tmp_path / "a.patches"
    write_patches(path, draw_patches(1, labelled=False))

    def full(descriptor):
        raise OSError(28, "No space left on device")

    with serving(path) as (server, store):
        monkeypatch.setattr("os.fsync", full)
        status, _, content = ask(server, "POST", "/api/label", LABEL)
        assert (status, "no space left" in content["error"]) == (500, True)
        assert store.counts()["n_by_hand"] == 0


def test_without_a_model_the_largest_patch_comes_first_with_those_close_by(tmp_path):
    path = tmp_path / "a.patches"
    write_patches(path, draw_patches(1, labelled=False))
    with serving(path, with_model=False) as (server, _):
        state = ask(server, "GET", "/api/state")[2]
        assert state["has_model"] is False
        found = ask(server, "GET", f"/api/patch/{state['order'][0]}")[2]
        assert (found["p"], found["reasons"], len(found["neighbours"])) == (None, [], 10)


def test_it_listens_on_this_machine_alone_and_a_port_that_is_taken_is_said(path, served):
    server, _ = served
    assert server.server_address[0] == "127.0.0.1"
    assert server.url.startswith("http://127.0.0.1:")
    assert len(server.token) >= 40
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        copy = path.with_name("b.patches")
        write_patches(copy, draw_patches(1))
        with open_store(str(copy)) as store, pytest.raises(UsageError, match="cannot be used"):
            LabelServer(Page(store, None), taken.getsockname()[1])


def test_names_are_text(tmp_path):
    path = tmp_path / "<img src=x onerror=alert(1)>.patches"
    write_patches(path, draw_patches(1))
    with serving(path, with_model=False) as (server, _):
        content = ask(server, "GET", f"/?token={server.token}")[2]
    assert b"<img" not in content.partition(b"<script>")[0]
    assert b"&lt;img src=x" in content


def test_labels_of_a_field_are_shown_as_such(tmp_path):
    path = tmp_path / "a.patches"
    write_patches(path, draw_patches(1))
    with serving(path, with_model=False) as (server, _):
        state = ask(server, "GET", "/api/state")[2]
    assert state["from_field"] == draw_patches(1).label.tolist()
    assert set(state["said"]) == {254}
    assert PLAUSIBLE in state["from_field"]
