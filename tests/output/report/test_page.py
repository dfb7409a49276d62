from __future__ import annotations

import dataclasses
import gzip
import re
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest

from prf.model.coloring import Draws
from prf.model.window import Window
from prf.output.report import embedded, write_report
from prf.output.report.embedded import fitting, pack_draws, pack_scene, step_of, thinned
from prf.output.report.page import title_of
from prf.output.run import Run
from prf.shell.errors import InputError
from tests.factories import make_run, make_trajectory
from tests.mapq.report.results import without_scripts


def written(path: Path, **options: str) -> str:
    write_report(str(path), slow_run(), **options)
    return path.read_text()


def test_a_page_is_named_after_its_log_and_says_what_it_shows(tmp_path: Path) -> None:
    page = written(tmp_path / "r.html")
    assert "<h1>&lt;b&gt;hall<small></small></h1>" in page
    assert "160 maps drawn by 3 chains from 200 laser beams, over a window of 8.0 × 6.5 m." in page
    assert '<span class="tag converged">converged</span> The chains agree on 100 % of the seen ground.' in page
    assert "all 160 draws of the run, as prf query" in page
    assert "/logs/&lt;b&gt;hall.log.gz, sha256 0" in page
    assert "<h1>Ours<small></small></h1>" in written(tmp_path / "o.html", title="Ours")


def test_a_run_that_has_hardly_begun_has_no_share_of_agreement(tmp_path: Path) -> None:
    run = slow_run()
    diagnostics = {**(run.diagnostics or {}), "functionals": {"log_likelihood": {"rhat": 3.3, "ess": 12.0}}}
    write_report(str(tmp_path / "r.html"), dataclasses.replace(run, diagnostics=diagnostics))
    page = (tmp_path / "r.html").read_text()
    assert "The run is too short to say where the chains agree." in page
    assert "of the seen ground" not in page


def test_the_run_is_named_beside_its_log_where_it_is_called_otherwise(tmp_path: Path) -> None:
    for folder, shown in (("second", "<small>, run second</small>"), ("<b>hall", "<small></small>")):
        write_report(str(tmp_path / "r.html"), dataclasses.replace(slow_run(), path=tmp_path / folder))
        page = (tmp_path / "r.html").read_text()
        assert f"<h1>&lt;b&gt;hall{shown}</h1>" in page
    assert "<title>&lt;b&gt;hall: posterior over maps</title>" in page


def test_sampled_poses_are_in_the_head_and_in_the_scene(tmp_path: Path) -> None:
    run = slow_run()
    assert run.laser is not None
    found = make_trajectory(run.laser, len(run.draws))
    run = dataclasses.replace(run, trajectory=found)
    write_report(str(tmp_path / "r.html"), run)
    page = (tmp_path / "r.html").read_text()
    assert f" of the seen ground.<br>{found.words()}. The farthest pose moved 5.1 cm.</p>" in page
    scene = pack_scene(run)
    assert (scene.head["given"], scene.head["path"], scene.head["ellipses"]) == (10, 10, 30)
    numbers = unpacked(scene.text)
    moved, given = numbers[:10:2], numbers[10:20:2]
    np.testing.assert_allclose((moved - given) * step_of(WINDOW), 0.05, atol=0.002)
    middle, end = numbers[20:50].reshape(5, 3, 2)[:, :2].swapaxes(0, 1)
    np.testing.assert_allclose(np.hypot(*(end - middle).T) * step_of(WINDOW), 0.0245, atol=0.005)


def test_poses_of_a_file_are_no_log() -> None:
    inputs = [{"path": "a/hall.log"}, {"path": "a/way.tum"}]
    run = dataclasses.replace(slow_run(), manifest={"inputs": inputs, "configuration": {"poses": "a/way.tum"}})
    assert title_of(run) == "hall"


def test_nothing_of_a_page_lies_elsewhere_and_nothing_in_it_is_markup(tmp_path: Path) -> None:
    slow_run().report(tmp_path / "r.html")
    page = without_scripts((tmp_path / "r.html").read_text())
    assert re.findall(r"(?:src|href)=[\"'](?!#)", page) == []
    assert "url(" not in page
    assert "default-src 'none'" in page
    assert "<b>hall" not in page


def test_places_where_chains_differ_and_what_would_help_are_in_the_second_sentence(tmp_path: Path) -> None:
    run = slow_run()
    assert run.image is not None
    differs = run.image.disagreement.copy()  # type: ignore[union-attr]
    differs[2:5, 3:6] = 0.9
    bad = {"rhat": 1.4, "ess": 8.0, "state": "varies", "seen": True}
    stuck = {"rhat": None, "ess": None, "state": "stuck", "seen": True}
    diagnostics = {"converged": False, "suggested_seconds": 280.0, "functionals": {"n_edges": bad, "colour": stuck}}
    image = run.image._replace(disagreement=differs, seen=run.image.seen | True)
    run = dataclasses.replace(run, image=image, diagnostics=diagnostics)
    write_report(str(tmp_path / "r.html"), run)
    page = (tmp_path / "r.html").read_text()
    assert "and differ most at" in page
    assert "(−2.1, 9,995.4)</button></span>; about 5 minutes more may bring agreement." in page
    assert page.index("<td>colour</td>") < page.index("<td>n_edges</td><td>1.400</td><td>8</td><td>seen</td>")
    write_report(str(tmp_path / "f.html"), dataclasses.replace(run, diagnostics={**diagnostics, "trend": "flat"}))
    assert "; more time alone will not help." in (tmp_path / "f.html").read_text()


def test_a_run_without_draws_or_image_is_refused(tmp_path: Path) -> None:
    for run, match in (
        (make_run(n_draws=0), "no draws yet"),
        (dataclasses.replace(slow_run(), image=None), "posterior"),
    ):
        with pytest.raises(InputError, match=match):
            write_report(str(tmp_path / "r.html"), run)
    assert list(tmp_path.iterdir()) == []


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


# Runs whose chains move slowly, as chains do: each map stays for some draws.


WINDOW = Window(-3.25, 9_994.5, 4.7531, 10_001.0)
"""Not of whole millimetres, and far from the origin."""


def slow_run(seed: int = 1, n_draws: int = 160) -> Run:
    """Return a run of three chains, one longer than the others, as the draws were recorded: in turn."""
    run = make_run(seed, 24, WINDOW, resolution=0.25)
    rng = np.random.default_rng(seed)
    chain = np.append(np.arange(n_draws - 10) % 3, np.zeros(10)).astype(np.int32)
    shown = np.empty(n_draws, np.int64)
    for each in range(3):
        rows = np.flatnonzero(chain == each)
        shown[rows] = 8 * each + np.cumsum(rng.random(len(rows)) < 0.4) % (10 + 2 * each)
    draws = Draws.from_colorings([run.draws[i % 24] for i in shown])
    functionals = {"n_edges": draws.n_edges.astype(np.float64), "log_posterior": rng.normal(size=n_draws)}
    return dataclasses.replace(
        run,
        manifest={**run.manifest, "inputs": [{"path": "/logs/<b>hall.log.gz", "sha256": "0"}]},
        draws=draws,
        chain=chain,
        step=1000 * np.arange(n_draws, dtype=np.int64),
        functionals=functionals,
        probe_black=rng.random((n_draws, 3)) < 0.5,
    )


def unpacked(text: str) -> np.ndarray:
    """Return the whole numbers of a packed text."""
    planes = np.frombuffer(gzip.decompress(b64decode(text)), np.uint8)
    return np.ascontiguousarray(planes.reshape(4, -1).T).view("<i4").ravel()
