"""A browser without a window, skipped with a reason where there is none."""

from __future__ import annotations

import shutil

import pytest

FLAGS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-quic",
    "--disable-sync",
    "--no-first-run",
]


@pytest.fixture(scope="session")
def browser():
    """Yield Debian's chromium, driven by playwright."""
    api = pytest.importorskip("playwright.sync_api", reason="needs playwright (pip install '.[dev]')")
    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("needs a browser (apt-get install chromium)")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def page(browser):
    """Yield a page on which every error fails the test."""
    page = browser.new_page(viewport={"width": 1400, "height": 900})
    page.set_default_timeout(120_000)  # of milliseconds: machines may be busy
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    yield page
    page.close()
    assert errors == []


@pytest.fixture
def phone(browser):
    """Yield a page of a telephone whose system is dark."""
    page = browser.new_page(viewport={"width": 390, "height": 844}, color_scheme="dark", has_touch=True)
    page.set_default_timeout(120_000)
    yield page
    assert page.evaluate("[document.documentElement.scrollWidth, document.documentElement.dataset.theme]") == [
        390,
        "dark",
    ]
    page.close()
