"""The report on a run in a browser: answers as `prf query` gives them, draws, layers, keys, phones."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from prf.model.coloring import black_at
from prf.output.report import live, write_report
from prf.output.report.embedded import thinned
from tests.factories import make_trajectory
from tests.output.report.test_page import WINDOW, slow_run

PATHS = ("-2, 9996; -1, 9997", "0, 9999; 3, 9999; 3, 9996", "1, 9998", "-3.2, 9995; 4.7, 10000.9")
FILLED = """async ([draw, points]) => {
  const data = await Page.unpackJson("data"),
    draws = new Prf.Draws(data.draws, await Page.unpack("draws"), data.window, data.step),
    pen = document.createElement("canvas").getContext("2d"),
    area = draws.area(draw);
  const isFilled = (point) => pen.isPointInPath(area, ...draws.local(point), "evenodd");
  return points.map((point) => [isFilled(point), !!draws.blackAt(point)[draw]]);
}"""


@pytest.fixture(scope="module")
def run():
    found = slow_run()
    return dataclasses.replace(found, trajectory=make_trajectory(found.laser, len(found.draws)))


@pytest.fixture(scope="module")
def report(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "hall.html"
    write_report(str(path), run)
    return path


@pytest.fixture
def opened(page, report):
    page.goto(report.as_uri())
    page.wait_for_selector("body[data-ready]")
    return page


def asked(page, words: str) -> list[float]:
    """Give coordinates and return the probability and its bounds."""
    page.fill("#where", words)
    page.keyboard.press("Enter")
    return answer(page)


def answer(page) -> list[float]:
    low, _, high = page.locator("#bounds").inner_text().partition(" to ")
    return [float(text) for text in (page.locator("#answer strong").inner_text(), low, high)]


def test_points_are_answered_as_by_query(opened, run):
    points = np.random.default_rng(5).uniform(WINDOW[:2], WINDOW[2:], (40, 2)).round(2)
    found = run.query(points, interval=True)
    wanted = np.column_stack([found.probability, found.low, found.high])
    assert len(np.unique(wanted[:, 0])) > 10
    given = [asked(opened, f"{x}, {y}") for x, y in points]
    np.testing.assert_allclose(given, wanted, atol=1.1e-3)
    figures = opened.locator("#answer .note").first.inner_text()
    assert figures.startswith(f"ESS {found.ess[-1]:.0f}, R-hat {found.rhat[-1]:.2f}")


def test_paths_are_answered_as_by_query(opened, run):
    opened.click("[data-tool=path]")
    for radius in ("0.25", "0.7"):
        opened.locator("#radius").fill(radius)
        for words in PATHS:
            path = [[float(value) for value in pair.split(",")] for pair in words.split(";")]
            found = run.paths([path], float(radius), interval=True)
            np.testing.assert_allclose(asked(opened, words), [column[0] for column in found[:3]], atol=1.1e-3)
    assert 0.0 < run.paths([[1.0, 9998.0]], 0.25)[0] < 1.0
    opened.fill("#where", "0, 0")
    opened.keyboard.press("Enter")
    assert "Outside the window" in opened.locator("#answer").inner_text()


def test_what_a_beam_meets_is_told_and_shown(opened, run):
    square = run.image.resolution
    assert square > 0.2, "the cells are larger than the usual square"
    row, column = np.transpose(np.nonzero(run.image.seen))[::37][1]
    x, y = run.image.origin + run.image.resolution * np.array([column + 0.5, row + 0.5])
    asked(opened, f"{x}, {y}")
    words = opened.locator("#returned").inner_text()
    assert float(words.split()[0]) == pytest.approx(run.return_probability([[x, y]], square)[0], abs=0.01)
    assert words.endswith(f"(p_return of {square:g} m)")
    before = opened.evaluate("document.getElementById('map').toDataURL()")
    opened.click("[data-base=returns]")
    assert "a beam which comes here" in opened.locator("#shown").inner_text()
    assert opened.evaluate("document.getElementById('map').toDataURL()") != before


@pytest.mark.parametrize("draw", [0, 71, 159])
def test_a_draw_is_filled_with_its_colours(opened, run, draw):
    points = np.random.default_rng(draw).uniform(WINDOW[:2], WINDOW[2:], (300, 2))
    filled, black = np.transpose(opened.evaluate(FILLED, [draw, points.tolist()]))
    number = np.argsort(run.chain, kind="stable")[draw]
    assert (filled == black).mean() > 0.995
    assert (black == black_at(run.draws[number], points)).mean() > 0.995


def test_a_click_asks_there_and_corners_of_a_path_can_be_taken_back(opened, run):
    box = opened.locator("#map").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    opened.mouse.click(*middle)
    x, y = (float(value) for value in opened.locator("#where").input_value().split(","))
    assert (x, y) == pytest.approx(((WINDOW[0] + WINDOW[2]) / 2, (WINDOW[1] + WINDOW[3]) / 2), abs=0.02)
    np.testing.assert_allclose(answer(opened)[0], run.query([[x, y]], interval=True).probability[0], atol=6e-4)
    opened.click("[data-tool=path]")
    opened.mouse.click(middle[0] + 60, middle[1])
    opened.mouse.click(middle[0] + 60, middle[1] + 60)
    assert opened.locator("#where").input_value().count(";") == 2
    opened.click("#undo")
    assert opened.locator("#where").input_value().count(";") == 1
    opened.get_by_text("show one").click()
    assert opened.locator("[data-base=draw]").get_attribute("aria-pressed") == "true"
    opened.click("#clear")
    assert opened.locator("#answer").inner_text().startswith("How probably a disc can follow a path")


def test_draws_layers_and_themes_change_the_picture(opened):
    picture = "document.getElementById('map').toDataURL()"
    seen = [opened.evaluate(picture)]

    def look() -> None:
        seen.append(opened.evaluate(picture))

    opened.focus("#draw")
    for _ in range(2):
        opened.keyboard.press("ArrowRight")
        look()
    assert "draw 3 of 160: chain 3, step 2,000" in opened.locator("#drawn").inner_text()
    for button in ("#outline", "[data-base=best]", "#path", "#ellipses", "#given", "#readings", "#theme"):
        opened.click(button)
        look()
    opened.focus("#map")
    look()
    for key in ("+", "ArrowLeft", "0"):
        opened.keyboard.press(key)
        opened.wait_for_timeout(60)
        look()
    assert len(set(seen)) == len(seen) - 1, "only the last key leads back"
    assert opened.evaluate("document.documentElement.dataset.theme") == "dark"
    opened.keyboard.press("Enter")
    assert opened.locator("#bounds").count() == 1


ORANGE = """() => {
  const map = document.getElementById("map"),
    { data } = map.getContext("2d").getImageData(0, 0, map.width, map.height);
  const columns = [...Array(map.width * map.height).keys()]
    .filter((i) => data[4 * i] > 200 && data[4 * i + 1] < 130 && data[4 * i + 2] < 60)
    .map((i) => i % map.width);
  return [columns, map.width, map.height];
}"""


def test_edges_of_the_best_map_end_where_readings_do(page, run, tmp_path):
    image, window = run.image, run.draws.window
    last = image.seen.shape[1] // 2
    seen = np.zeros_like(image.seen)
    seen[:, :last] = True
    write_report(str(tmp_path / "half.html"), dataclasses.replace(run, image=image._replace(seen=seen)))
    page.goto((tmp_path / "half.html").as_uri())
    page.wait_for_selector("body[data-ready]")
    columns, wide, high = page.evaluate(ORANGE)
    scale = min((wide - 70) / window.width, (high - 56) / window.height)
    border = image.origin[0] + (last + 1) * image.resolution
    assert len(columns) > 200
    assert max(columns) <= wide / 2 + (border - (window.x_min + window.x_max) / 2) * scale + 1
    page.click("#outline")
    assert page.evaluate(ORANGE)[0] == []


def test_the_best_map_and_the_view_are_saved(opened, run, tmp_path):
    for button, name, start in (("#geojson", "run.geojson", b'{"schema'), ("#png", "run.png", b"\x89PNG")):
        with opened.expect_download() as saved:
            opened.click(button)
        assert saved.value.suggested_filename == name
        saved.value.save_as(tmp_path / name)
        assert (tmp_path / name).read_bytes().startswith(start)
    assert json.loads((tmp_path / "run.geojson").read_text())["geometry"]["type"] == "MultiPolygon"


def test_a_phone_shows_map_and_question_together(phone, report):
    phone.goto(report.as_uri())
    phone.wait_for_selector("body[data-ready]")
    phone.locator("#map").evaluate("map => map.scrollIntoView()")
    phone.locator("#map").tap()
    box = phone.locator("#answer").bounding_box()
    assert box["y"] + box["height"] < 844


def test_two_fingers_zoom_and_ask_nothing(phone, report):
    phone.goto(report.as_uri())
    phone.wait_for_selector("body[data-ready]")
    box, session = phone.locator("#map").bounding_box(), phone.context.new_cdp_session(phone)
    before = phone.evaluate("document.getElementById('map').toDataURL()")
    for kind, apart in (("touchStart", 40), ("touchMove", 60), ("touchMove", 120), ("touchEnd", None)):
        places = [] if apart is None else [box["x"] + box["width"] / 2 + side * apart for side in (-1, 1)]
        points = [{"x": x, "y": box["y"] + 100, "id": number} for number, x in enumerate(places)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    phone.wait_for_timeout(100)
    assert phone.evaluate("document.getElementById('map').toDataURL()") != before
    assert phone.locator("#where").input_value() == ""


def test_distances_are_measured_by_clicks_keys_and_numbers(opened):
    opened.click("[data-tool=length]")
    box = opened.locator("#map").bounding_box()
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    opened.mouse.click(*middle)
    assert "a second place" in opened.locator("#answer").inner_text()
    opened.mouse.click(middle[0] + 90, middle[1] + 120)
    (x, y), (a, b) = ([float(value) for value in pair.split(",")] for pair in opened.input_value("#where").split(";"))
    assert float(opened.locator("#total").inner_text().split()[0]) == pytest.approx(np.hypot(a - x, b - y), abs=0.006)
    opened.fill("#where", "0, 9999; 3, 9999; 3, 9995")
    opened.keyboard.press("Enter")
    assert opened.locator("#answer").inner_text() == "7.00 m along 2 legs, the last of 4.00 m"
    opened.focus("#map")
    opened.keyboard.press("Backspace")
    assert opened.locator("#total").inner_text() == "3.00 m"
    opened.keyboard.press("Enter")
    assert opened.locator("#where").input_value().count(";") == 2


def test_a_page_follows_a_run_under_way_and_keeps_what_was_asked(page, run, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(live, "EVERY", 0.0)
    monkeypatch.setattr(live, "SHARE", float("inf"))
    early = dataclasses.replace(thinned(run, 4), trajectory=None)
    with live.LiveReport(browser=False) as report:
        report.update(lambda: early)
        report._making.result()
        page.goto(re.search(r"http://\S+", capsys.readouterr().err)[0])
        page.wait_for_selector("body[data-ready]")
        assert page.locator("#places").is_hidden()
        before = asked(page, "0, 9999")
        page.focus("#map")
        page.keyboard.press("+")
        report.update(lambda: run)
        page.locator("#draw[max='159']").wait_for()
        assert page.input_value("#where") == "0, 9999"
        assert answer(page) != before
        assert answer(page)[0] == pytest.approx(run.query([[0.0, 9999.0]], interval=True).probability[0], abs=1e-3)
        write_report(str(tmp_path / "run.html"), run, "Whole")
        report.finish(str(tmp_path / "run.html"))
    page.get_by_text("The run has ended; this page is complete.").wait_for()
    assert answer(page)[0] == pytest.approx(run.query([[0.0, 9999.0]], interval=True).probability[0], abs=1e-3)
