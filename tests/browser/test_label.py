"""The labelling page in a browser: keys, undo, a killed server, and strangers."""

from __future__ import annotations

import signal
import urllib.error
import urllib.request

import numpy as np
import pytest

from mapq.io import read_patches, write_patches
from tests.cli.test_mapq_train import Running
from tests.mapq.labelled import draw_patches

KEYS = {"p": 0, "s": 1, "u": 255}


@pytest.fixture
def saved(tmp_path):
    path = tmp_path / "walls.patches"
    write_patches(path, draw_patches(1, labelled=False))
    return path


@pytest.fixture
def running():
    """Yield a function that starts the verb; whatever still runs at the end is killed."""
    started = []

    def start(path):
        started.append(Running(path))
        return started[-1]

    yield start
    for each in started:
        if each.process.poll() is None:
            each.end(signal.SIGKILL)


def open_page(page, server):
    page.goto(server.url)
    page.wait_for_selector("body[data-ready]")


def patch_on(page) -> int:
    return int(page.locator("body").get_attribute("data-patch"))


def press(page, key: str, n_by_hand: int) -> int:
    """Label the patch shown by a key, wait until it is confirmed and the next is shown, and return the patch."""
    patch = patch_on(page)
    page.keyboard.press(key)
    page.wait_for_selector(f'body[data-done="{n_by_hand}"]:not([data-patch="{patch}"])')
    return patch


@pytest.mark.slow
def test_twenty_patches_by_keys_a_kill_and_on_from_there(page, saved, running):
    server = running(saved)
    loading: set[object] = set()
    page.on("request", lambda request: loading.add(request))
    for end in ("requestfinished", "requestfailed"):
        page.on(end, lambda request: loading.discard(request))
    open_page(page, server)
    keys = ["p", "s", "u", "s"] * 5
    said = {press(page, key, number + 1): KEYS[key] for number, key in enumerate(keys)}
    assert len(said) == 20
    while loading:  # an answer that the kill cuts short is an error to the browser
        page.wait_for_timeout(10)
    assert server.end(signal.SIGKILL)[0] == -signal.SIGKILL
    found = read_patches(saved)
    assert {int(patch): int(found.label[patch]) for patch in np.flatnonzero(found.label_source)} == said

    server = running(saved)
    open_page(page, server)
    assert "20 of 32 labelled: 5 plausible, 10 suspicious, 5 unsure" in page.locator("#counts").inner_text()
    assert patch_on(page) not in said
    last = list(said)[-1]
    page.keyboard.press("z")
    page.wait_for_selector(f'body[data-done="19"][data-patch="{last}"]')
    assert page.locator("#said").inner_text() == "not labelled yet"
    page.keyboard.press("Backspace")
    page.wait_for_selector(f'body[data-done="18"][data-patch="{list(said)[-2]}"]')
    page.click("#finish")
    page.wait_for_selector("body[data-ended]")
    assert server.end()[0] == 0
    assert list(saved.parent.iterdir()) == [saved]
    found = read_patches(saved)
    assert {int(patch): int(found.label[patch]) for patch in np.flatnonzero(found.label_source)} == dict(
        list(said.items())[:18]
    )


def test_a_phone_has_all_buttons_on_its_first_screen(phone, saved, running):
    open_page(phone, running(saved))
    boxes = [button.bounding_box() for button in phone.locator(":is(header, footer) button").all()]
    assert len(boxes) == 9
    assert all(box["y"] + box["height"] <= 844 and box["x"] + box["width"] <= 390 for box in boxes)


@pytest.mark.slow
def test_back_and_forward_and_another_mind(page, saved, running):
    server = running(saved)
    open_page(page, server)
    first = press(page, "p", 1)
    second = patch_on(page)
    page.keyboard.press("ArrowLeft")
    page.wait_for_selector(f'body[data-patch="{first}"]')
    assert page.locator("#said").inner_text() == "you said plausible"
    page.keyboard.press("s")
    page.wait_for_selector(f'body[data-patch="{second}"]')
    page.keyboard.press("ArrowLeft")
    page.wait_for_selector(f'body[data-patch="{first}"]')
    assert page.locator("#said").inner_text() == "you said suspicious"
    page.keyboard.press("ArrowRight")
    page.wait_for_selector(f'body[data-patch="{second}"]')
    assert read_patches(saved).label[first] == 1
    assert server.end(signal.SIGINT)[0] == 130
    assert read_patches(saved).label_source[first] == 2


@pytest.mark.slow
def test_features_reasons_and_neighbours_are_shown_and_the_model_can_be_hidden(page, saved, running):
    open_page(page, running(saved))
    text = page.locator("#details").inner_text()
    assert "What the model says" in text
    assert page.locator("#reasons li").count() > 0
    assert page.locator("#neighbours li").count() > 0
    assert "off its plane (rms)" in text
    page.keyboard.press("h")
    assert "What the model says" not in page.locator("#details").inner_text()
    patch = patch_on(page)
    page.locator("#neighbours .link").first.click()
    page.wait_for_selector(f'body:not([data-patch="{patch}"])')


@pytest.mark.slow
def test_a_lost_server_is_reported_and_the_page_stays(browser, saved, running):
    server, page = running(saved), browser.new_page()
    open_page(page, server)
    patch = patch_on(page)
    server.end(signal.SIGKILL)
    page.keyboard.press("p")
    page.wait_for_selector("#trouble:not([hidden])")
    assert "does not answer" in page.locator("#trouble").inner_text()
    assert patch_on(page) == patch
    assert "0 of 32" in page.locator("#counts").inner_text()
    page.close()


def test_strangers_are_refused(browser, saved, running, tmp_path):
    server = running(saved)
    address = server.url.partition("?")[0]
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(address, timeout=20)
    stranger = tmp_path / "stranger.html"
    stranger.write_text("<!DOCTYPE html><title>elsewhere</title>")
    page = browser.new_page()
    page.goto(stranger.as_uri())
    tries = {
        "no token": f"fetch('{address}api/state').then(a => a.status, () => 'blocked')",
        "blind": f"fetch('{address}api/label', {{method: 'POST', mode: 'no-cors', "
        "body: JSON.stringify({patch: 1, label: 'suspicious'})}).then(a => a.type, () => 'blocked')",
        "with the token": f"fetch('{address}api/state', {{headers: {{'X-Page-Token': '{server.token}'}}}})"
        ".then(a => a.status, () => 'blocked')",
        "page": f"fetch('{address}?token={server.token}').then(a => a.text(), () => 'blocked')",
    }
    found = {name: page.evaluate(code) for name, code in tries.items()}
    assert found.pop("blind") in ("blocked", "opaque")
    assert set(found.values()) == {"blocked"}
    page.set_content(f'<iframe src="{server.url}"></iframe>')
    page.wait_for_timeout(1_000)
    assert all(frame.query_selector("#plan") is None for frame in page.frames)
    page.close()
    assert not (read_patches(saved).label_source > 0).any()
