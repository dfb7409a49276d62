from __future__ import annotations

import numpy as np
import pytest

from prf.output.report import embedded
from prf.output.report.embedded import fitting, pack_draws, pack_scene, step_of, thinned
from tests.output.report.runs import slow_run, unpacked


def segments_of(head: dict, text: str, draw: int) -> set[tuple[int, ...]]:
    """Return the edges of a draw, as a page reads them, with their ends in order."""
    n, m = head["n_vertices"], head["n_edges"]
    x, y, a, b, first, last = np.split(unpacked(text), np.cumsum([n, n, m, m, m]))
    xy, a = np.column_stack([np.cumsum(x), y]), np.cumsum(a)
    there = (first <= draw) & (draw < first + last)
    ends = np.stack([xy[a[there]], xy[a[there] + b[there]]], axis=1)
    return {tuple(sorted(map(tuple, pair))) for pair in ends.tolist()}  # type: ignore[misc]


def test_every_draw_has_its_edges_to_the_millimetre_and_each_edge_is_stored_once() -> None:
    run = slow_run()
    head, text = pack_draws(run)
    order = np.argsort(run.chain, kind="stable")
    window, step = run.draws.window, step_of(run.draws.window)
    for place, number in enumerate(order):
        lines = run.draws[number].xy[run.draws[number].edges]
        wanted = np.rint((lines - [window.x_min, window.y_min]) / step).astype(int)
        found = segments_of(head, text, place)
        assert len(found) == len(wanted)
        pairs = {tuple(sorted(map(tuple, pair))) for pair in wanted.tolist()}
        assert all(np.abs(np.subtract(*each)).max() <= 1 for each in zip(sorted(found), sorted(pairs), strict=True))
    assert head["starts"] == [0, 60, 110, 160]
    assert head["n_edges"] < 0.5 * run.draws.n_edges.sum()


def test_a_page_takes_what_fits_and_keeps_the_newest_of_each_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    run = slow_run()
    assert fitting(run)[0] is run
    monkeypatch.setattr(embedded, "MAX_BYTES", len(pack_draws(run).text) // 2)
    kept, numbers = fitting(run)
    assert len(numbers.text) <= embedded.MAX_BYTES
    assert 10 < len(kept.draws) < 160
    assert [kept.step[kept.chain == each].max() for each in range(3)] == [
        run.step[run.chain == each].max() for each in range(3)
    ]
    assert np.array_equal(thinned(run, 1).step, run.step)


def test_path_readings_and_edges_of_the_best_map_are_in_the_scene() -> None:
    run = slow_run()
    assert run.laser is not None
    assert run.best is not None
    head, text = pack_scene(run)
    numbers = unpacked(text)
    assert len(numbers) == sum(head.values())
    corner = np.array([run.draws.window.x_min, run.draws.window.y_min])
    path = numbers[: head["path"]].reshape(-1, 2) * step_of(run.draws.window) + corner
    np.testing.assert_allclose(path, run.laser.sensor_path(), atol=1e-3)
    assert head["returns"] == 2 * run.laser.returned.sum()
    assert 0 < head["best"] <= 4 * run.best.n_edges
