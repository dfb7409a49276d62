from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from prf.output.report import write_report
from prf.output.report.embedded import pack_scene, step_of
from prf.output.report.words import title_of
from prf.shell.errors import InputError
from tests.factories import make_run, make_trajectory
from tests.mapq.report.results import without_scripts
from tests.output.report.runs import WINDOW, slow_run, unpacked


def written(path: Path, **options: str) -> str:
    write_report(str(path), slow_run(), **options)
    return path.read_text()


def test_a_page_is_named_after_its_log_and_says_what_it_shows(tmp_path: Path) -> None:
    page = written(tmp_path / "r.html")
    assert "<h1>&lt;b&gt;hall</h1>" in page
    assert "160 maps drawn by 3 chains from 200 laser beams, over a window of 8.003 × 6.5 m." in page
    assert '<span class="tag converged">converged</span> The chains agree on 100 % of the seen ground.' in page
    assert "all 160 draws of the run, as prf query" in page
    assert "/logs/&lt;b&gt;hall.log.gz, sha256 0" in page
    assert "<h1>Ours</h1>" in written(tmp_path / "o.html", title="Ours")


def test_sampled_poses_are_in_the_head_and_in_the_scene(tmp_path: Path) -> None:
    run = slow_run()
    assert run.laser is not None
    found = make_trajectory(run.laser, len(run.draws))
    run = dataclasses.replace(run, trajectory=found)
    write_report(str(tmp_path / "r.html"), run)
    page = (tmp_path / "r.html").read_text()
    assert f" of the seen ground. {found.words()}; the farthest by 5.1 cm.</p>" in page
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
    assert "(−2.1, 9,995.4)</button></span>; about 5 minutes more would bring agreement." in page
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
