"""The picture of a run while it is sampled: it fits the terminal and says what there is to say."""

from __future__ import annotations

import numpy as np
import pytest

from prf.diagnostics import Diagnosis
from prf.render.live import FACTS, WIDE, Glance, live_lines
from prf.render.live_map import MapGlance, live_map_lines
from prf.shell.terminal import Screen
from tests.factories import make_run

SCREEN = Screen(120, 40, "truecolor", blocks=True, braille=True)
NAN = float("nan")


def glance(**changes: object) -> Glance:
    run = make_run()
    assert run.image is not None
    whole = Glance(
        name="office",
        window=run.draws.window,
        image=run.image,
        best=run.best,
        step=60_000,
        chains=4,
        rungs=1,
        seconds=30.0,
        steps_per_second=8_000.0,
        share=0.25,
        is_limit=False,
        diagnoses={
            "n_edges": Diagnosis(1.01, 300.0, "varies"),
            "log_posterior": Diagnosis(1.2, 40.0, "varies"),
            "colour at (1.00, 2.00)": Diagnosis(NAN, NAN, "constant"),
            "colour at (3.00, 2.00)": Diagnosis(1.4, 20.0, "varies"),
        },
        accepted=[("triangle birth", 1000, 10), ("triangle death", 0, 0), ("slide vertex", 1000, 300)],
    )
    return whole._replace(**changes)


def shown(view: Glance, screen: Screen) -> str:
    return "\n".join(line.plain for line in live_lines(view, screen))


@pytest.mark.parametrize("columns", [20, 60, 80, WIDE - 1, WIDE, 133, 250])
@pytest.mark.parametrize("rows", [8, 24, 50, 100])
@pytest.mark.parametrize("colours", [None, "truecolor"])
def test_it_fits_the_terminal(columns: int, rows: int, colours: str | None) -> None:
    screen = SCREEN._replace(columns=columns, rows=rows, colours=colours)
    lines = live_lines(glance(), screen)
    assert len(lines) < max(rows, 12)
    assert max(line.cell_len for line in lines) <= columns


def test_where_chains_differ_is_named() -> None:
    image = glance().image
    assert image.agreement() is not None
    differs = np.zeros_like(image.occupancy)
    differs[image.seen] = np.where(np.arange(image.seen.sum()) == 0, 0.7, 0.0)
    text = shown(glance(image=image._replace(disagreement=differs)), SCREEN)
    assert f"agree on {100 * (image.seen.sum() - 1) // image.seen.sum()} % of the seen ground" in text
    assert "differ round (" in text
    assert "seen ground" not in shown(glance(image=image._replace(disagreement=None)), SCREEN)


def test_a_wide_terminal_has_all_facts_beside_the_picture() -> None:
    text = shown(glance(), SCREEN)
    assert "office: 4 chains" in text
    assert "step 60,000, 8,000 steps/s" in text
    assert "███░░░░░░░░░ 0:00:30, 0:01:30 left" in text
    assert "at most" not in text
    for row in ("n edges                    1.010     300", "log posterior              1.200      40"):
        assert row in text
    assert "worst of 2 points          1.400      20" in text
    assert "accepted 15.5 % of 2,000 proposals" in text
    assert "30.0 %  slide vertex" in text
    assert "triangle death" not in text, "a move that was never proposed"
    first = live_lines(glance(), SCREEN)[0].plain
    assert first[-FACTS:].lstrip().startswith("office: 4 chains") or "office: 4 chains" in first


def test_a_narrow_one_has_the_worst_of_them_below() -> None:
    lines = [line.plain for line in live_lines(glance(), SCREEN._replace(columns=70, rows=24))]
    assert lines[-5].startswith("office: 4 chains")
    assert lines[-2] == "colour at (3.00, 2.00): R-hat 1.400, ESS 20"
    assert lines[-1] == "accepted 15.5 % of 2,000 proposals"


def test_what_is_not_known_yet_is_left_out() -> None:
    fresh = glance(diagnoses={}, best=None, share=0.0, accepted=[], rungs=6)
    text = shown(fresh, SCREEN)
    assert "4 chains of 6 rungs" in text
    assert "agreement of the chains: not checked yet" in text
    assert "left" not in text
    assert "accepted 0.0 % of 0 proposals" in text
    assert len(live_lines(fresh, SCREEN._replace(columns=70, rows=24))) <= 23


def test_a_limit_is_called_one() -> None:
    assert "left at most" in shown(glance(is_limit=True), SCREEN)


def test_agreement_has_a_colour() -> None:
    lines = live_lines(glance(), SCREEN)
    styles = {
        line.plain[span.start : span.end].split("  ")[0]: span.style
        for line in lines
        for span in line.spans
        if span.style in ("green", "yellow")
    }
    assert styles == {
        "n edges": "green",
        "log posterior": "yellow",
        "worst of 2 points": "yellow",
        "agree on 100 % of the seen ground": "green",
    }


def map_glance(**changes: object) -> MapGlance:
    best = make_run().best
    assert best is not None
    return MapGlance("office", best, (-1250.5, -1300.25), 0.05, 40_000, 20.0, 0.5)._replace(**changes)


@pytest.mark.parametrize("columns", [20, 80, WIDE, 200])
@pytest.mark.parametrize("rows", [8, 24, 60])
def test_the_best_map_fits_the_terminal(columns: int, rows: int) -> None:
    lines = live_map_lines(map_glance(), SCREEN._replace(columns=columns, rows=rows))
    assert len(lines) < max(rows, 12)
    assert max(line.cell_len for line in lines) <= columns


def test_the_best_map_has_its_score_and_the_temperature() -> None:
    view = map_glance()
    text = "\n".join(line.plain for line in live_map_lines(view, SCREEN._replace(colours=None)))
    assert f"office: best of 2 chains, {view.best.n_edges} edges" in text
    assert "score -1,250.5 nats, temperature 0.05" in text
    assert "step 40,000, 4,000 steps/s" in text
    assert "██████░░░░░░ 0:00:20, 0:00:20 left" in text
    assert "-1,300.2  nats, best of a chain" in text
    assert text.count("█") > 100, "its occupied area is filled"
