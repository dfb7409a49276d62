"""The report in a browser: patches are clicked, their reasons appear, and nothing is fetched from anywhere."""

from __future__ import annotations

import re

import pytest

from mapq.report.findings import read_findings
from mapq.report.page import write_report
from tests.mapq.factories import make_patches
from tests.mapq.report.results import save_result

MOVED_BY = 0.4
"""Metres between the copies of a doubled wall."""


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    return read_findings(str(save_result(tmp_path_factory.mktemp("report") / "walls.ply")))


@pytest.fixture(scope="module")
def report(told, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(str(path), told)
    return path


def open_report(page, path):
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_selector("body[data-ready]")
    return asked


def place_of(page, told, patch: int) -> tuple[float, float]:
    """Return where the plan view draws the middle of a patch, in pixels of the page, from what its axes say."""
    box = page.locator("#plan").bounding_box()
    xyz = told.cloud.xyz[told.patch >= 0]
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    scale = min((box["width"] - 50) / (high[0] - low[0]), (box["height"] - 40) / (high[1] - low[1]))
    centre = told.cloud.xyz[told.patch == patch].mean(axis=0) - (low + high) / 2
    return box["x"] + box["width"] / 2 + centre[0] * scale, box["y"] + box["height"] / 2 - centre[1] * scale


def severity(row) -> float:
    return row["p_suspicious"] * row["area_m2"]


def shown(page) -> str:
    return page.locator("#details").inner_text()


def test_a_patch_clicked_in_plan_view_shows_its_reasons_everywhere(page, told, report):
    open_report(page, report)
    patch = told.head["regions"][0]["patches"][0]
    page.mouse.click(*place_of(page, told, patch))
    text = shown(page)
    clicked = int(re.search(r"Patch (\d+)", text)[1])
    row = told.rows[clicked]
    assert row["label"] == "suspicious"
    assert clicked == patch or row["centroid"][1] == pytest.approx(told.rows[patch]["centroid"][1], abs=2 * MOVED_BY)
    assert f"{row['p_suspicious']:.3f}" in text
    assert f"{row['rms_m']:.3f} m" in text
    first = re.sub(r"^neighbour", "patch", row["reasons"][0]["text"])
    assert first in text
    assert page.locator(f'tr[data-patch="{clicked}"][aria-selected="true"]').count() == 1
    assert page.locator(f'tr[data-region="{row["region"]}"][aria-selected="true"]').count() == 1


def test_the_worst_patch_is_selected_at_first_and_dark_changes_the_views(page, told, report):
    open_report(page, report)
    worst = max(told.rows, key=lambda patch: (told.label[patch], severity(told.rows[patch])))
    assert f"Patch {worst}\n" in shown(page)
    pictures = set()
    for _ in range(2):
        pictures.add(page.evaluate("document.getElementById('plan').toDataURL()"))
        page.click("#theme")
    assert len(pictures) == 2
    assert page.locator("#theme").get_attribute("aria-pressed") == "false"


def test_a_phone_shows_the_main_reason_of_each_patch(phone, report):
    open_report(phone, report)
    assert phone.evaluate("document.documentElement.scrollHeight") <= 2 * 844
    phone.locator("#patches > summary").tap()
    row = phone.locator("tr[data-patch]").first
    box = row.locator("td:last-child").bounding_box()
    assert len(row.locator("td:visible").all()) == 4
    assert row.locator("td:last-child").inner_text() != "–"
    assert box["x"] + box["width"] <= 390


def test_a_phone_shows_the_whole_map_and_no_more(phone, told, report):
    """However tall the window is."""
    open_report(phone, report)
    phone.set_viewport_size({"width": 390, "height": 3000})
    box = phone.locator("#plan").bounding_box()
    aspect = float(re.search(r"--aspect: ([\d.]+)", report.read_text())[1])
    assert box["height"] <= max(224.0, box["width"] * aspect + 48.0) + 1.0
    for patch in (told.head["regions"][0]["patches"][0], told.head["regions"][-1]["patches"][-1]):
        phone.mouse.click(*place_of(phone, told, patch))
        row = told.rows[int(re.search(r"Patch (\d+)", shown(phone))[1])]
        assert row["centroid"][:2] == pytest.approx(told.rows[patch]["centroid"][:2], abs=2 * MOVED_BY)


@pytest.mark.slow
def test_a_row_a_reason_and_a_region_select_too(page, told, report):
    open_report(page, report)
    page.locator("tr[data-patch]").nth(2).click()
    patch = int(page.locator('tr[data-patch][aria-selected="true"]').get_attribute("data-patch"))
    assert f"Patch {patch}" in shown(page)
    other = int(page.locator("#reasons .link").first.inner_text().removeprefix("patch "))
    page.locator("#reasons .link").first.click()
    assert f"Patch {other}" in shown(page)
    page.locator("tr[data-region]").nth(1).click()
    assert "\nregion\t1" in shown(page)


def test_a_patch_clicked_in_space_is_selected(page, told, report):
    open_report(page, report)
    box = page.locator("#space").bounding_box()
    for down in (0.5, 0.45, 0.55, 0.4, 0.6):
        for right in (0.5, 0.4, 0.6, 0.3, 0.7):
            page.mouse.click(box["x"] + right * box["width"], box["y"] + down * box["height"])
            if page.locator('tr[data-patch][aria-selected="true"]').count():
                assert re.search(r"Patch \d+", shown(page))
                return
    pytest.fail("nothing was hit")


def test_the_3d_view_turns_and_moves(page, report):
    open_report(page, report)
    picture = "document.getElementById('space').toDataURL()"
    box = page.locator("#space").bounding_box()
    seen = [page.evaluate(picture)]
    for keys in ([], ["Shift"]):
        for key in keys:
            page.keyboard.down(key)
        page.mouse.move(box["x"] + 100, box["y"] + 100)
        page.mouse.down()
        page.mouse.move(box["x"] + 160, box["y"] + 130, steps=3)
        page.mouse.up()
        page.wait_for_timeout(100)
        seen.append(page.evaluate(picture))
    page.click("#whole")
    assert len(set(seen)) == 3


@pytest.mark.slow
def test_keys_alone_are_enough(page, told, report):
    open_report(page, report)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.locator("tr[data-patch]").first.focus()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    second = page.locator("tr[data-patch]").nth(1).get_attribute("data-patch")
    assert f"Patch {second}" in shown(page)
    page.keyboard.press("j")
    third = page.locator("tr[data-patch]").nth(2).get_attribute("data-patch")
    assert f"Patch {third}" in shown(page)
    page.keyboard.press("k")
    assert f"Patch {second}" in shown(page)


@pytest.mark.slow
def test_colours_sorting_and_finding(page, told, report):
    open_report(page, report)
    page.click("#palette")
    assert page.locator("body").get_attribute("data-palette") == "colour-blind"
    assert page.locator("#palette").get_attribute("aria-pressed") == "true"
    page.fill("#find", "7")
    assert page.locator("tr[data-patch]").count() == 1
    page.fill("#find", "")
    page.check("#only")
    assert "of 16" in page.locator("#page").inner_text()
    page.locator("#names th").first.click()
    numbers = [int(row.get_attribute("data-patch")) for row in page.locator("tr[data-patch]").all()]
    assert numbers == sorted(numbers)


def test_nothing_is_fetched(page, report):
    asked = open_report(page, report)
    page.click("tr[data-patch] >> nth=0")
    page.click("#near")
    page.click("#whole")
    page.wait_for_timeout(500)
    assert asked == [report.as_uri()]


def test_scripts_in_names_do_not_run(page, tmp_path):
    told = read_findings(str(save_result(tmp_path / "<script>document.title='taken'<.ply")))
    evil = "<img src=x onerror=\"document.title='taken'\"><script>document.title='taken'</script>"
    for row in told.rows.values():
        row["reasons"] = [{"text": evil, "log_odds": 1.0, "other": 2}]
        row["cause"] = {"kind": evil, "text": evil}
    path = tmp_path / "r.html"
    write_report(str(path), told)
    open_report(page, path)
    page.click("tr[data-patch] >> nth=0")
    assert evil in shown(page)
    assert page.title().startswith("<script>document.title='taken'<.ply")


@pytest.mark.slow
def test_a_map_without_patches_opens(page, tmp_path):
    told = read_findings(str(save_result(tmp_path / "r.ply", make_patches([], [], loose=20))))
    write_report(str(tmp_path / "r.html"), told)
    open_report(page, tmp_path / "r.html")
    assert "No plane patch was found" in page.locator("header").inner_text()


@pytest.mark.slow
def test_it_prints_on_paper_with_both_views(browser, report, tmp_path):
    target = tmp_path / "r.pdf"
    page = browser.new_page()
    try:
        open_report(page, report)
        page.pdf(path=str(target), format="A4", print_background=True)
    finally:
        page.close()
    # Two views of 2085 x 960 pixels, for the paper: as pictures of the screen they would be half as wide.
    assert len(re.findall(rb"/Width 2085\b", target.read_bytes())) >= 2


def test_patches_that_are_not_listed_are_drawn_and_named(page, told, tmp_path, monkeypatch):
    monkeypatch.setattr("mapq.report.findings.MAX_LISTED", 20)
    few = read_findings(told.path)
    write_report(str(tmp_path / "few.html"), few)
    open_report(page, tmp_path / "few.html")
    assert page.locator("#page").inner_text().endswith("of 20")
    last = max(few.rows)
    page.locator("#find").fill(str(last))
    page.locator("#rows tr").first.click()
    assert f"Patch {last}" in shown(page)
    other = next(patch for patch in range(len(told.label)) if patch not in few.rows)
    page.mouse.click(*place_of(page, told, other))
    assert "Not listed" in shown(page)


def test_distances_are_measured_in_plan(page, report):
    open_report(page, report)
    page.click("#measure")
    chosen = page.locator("#details h3").inner_text()
    box = page.locator("#plan").bounding_box()
    for right, down in ((0.3, 0.4), (0.6, 0.5)):
        page.locator("#plan").click(position={"x": right * box["width"], "y": down * box["height"]})
    first = page.locator("#measured").inner_text()
    assert re.fullmatch(r"[\d.,]+ m in plan", first)
    page.focus("#plan")
    page.keyboard.press("Enter")
    assert page.locator("#measured").inner_text() == "… to the second place"
    page.keyboard.press("ArrowLeft")
    page.wait_for_timeout(60)
    page.keyboard.press("Enter")
    assert page.locator("#measured").inner_text().endswith(" m in plan")
    assert page.locator("#details h3").inner_text() == chosen, "no patch is selected by a measuring click"
    page.click("#measure")
    assert page.locator("#measured").inner_text() == ""
