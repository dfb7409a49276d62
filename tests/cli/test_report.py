from __future__ import annotations

from pathlib import Path

from prf.results import write_run
from tests.cli.calls import call
from tests.factories import make_run


def test_the_page_is_beside_the_run_by_default(tmp_path: Path) -> None:
    write_run(tmp_path / "office", make_run(n_draws=4))
    done = call("prf report office", tmp_path)
    assert (done.code, done.out) == (0, "")
    assert "wrote office.html: 0." in done.err
    assert "answers from 4 of 4 draws" in done.err
    before = (tmp_path / "office.html").read_text()
    assert call("prf report .", tmp_path / "office").code == 4
    assert call("prf report . -f", tmp_path / "office").code == 0
    assert (tmp_path / "office.html").read_text() == before
