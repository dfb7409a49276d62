"""Every block of commands in README and docs is run, page by page, in a folder that holds a copy of data/."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.docs.blocks import commands_of, differences, rules_of
from tests.docs.runner import Runner

QUICK = ("docs/configuration.md", "docs/labelling.md", "docs/report.md", "docs/segmentation.md")
"""Pages that `make test` runs; the others take longer and are marked slow."""

PAGES = ["README.md", *(str(page.relative_to(ROOT)) for page in sorted((ROOT / "docs").rglob("*.md")))]
NOT_RUN = ("docs/reference/", "docs/verification.md")
"""Reference pages hold each verb's examples, which `tests/cli/test_verbs.py` parses; `tests/verify` runs its own."""

RUN = [name for name in PAGES if not name.startswith(NOT_RUN) and commands_of(ROOT / name, name)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a copy of data/, as a fresh clone has."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    return tmp_path


@pytest.fixture
def scheduler(request: pytest.FixtureRequest) -> Callable[[], str]:
    """Return what starts a Dask scheduler with a worker on this machine, once it is asked for, and its address."""

    def start() -> str:
        dask = pytest.importorskip("distributed")
        cluster = dask.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        )
        request.addfinalizer(cluster.close)
        return str(cluster.scheduler_address)

    return start


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in RUN]
)
def test_commands_of_a_page_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys, scheduler: Callable[[], str], name: str
) -> None:
    monkeypatch.chdir(folder)
    commands, rules = commands_of(ROOT / name, name), rules_of((ROOT / name).read_text())
    runner = Runner(folder, rules, capsys, scheduler)
    for command, follower in zip(commands, [*commands[1:], None], strict=True):
        runner.run(command, follower)
    assert runner.n_run > 0
    with capsys.disabled():
        if os.environ.get("SHOW_BLOCKS"):
            print(f"\n{name}: {runner.n_run} run, {runner.n_compared} compared, {runner.n_left_out} left out")


def test_every_rule_of_a_page_is_of_use() -> None:
    for name in RUN:
        rules = rules_of((ROOT / name).read_text())
        texts = [part.strip() for command in commands_of(ROOT / name, name) for part in command.text.split("&&")]
        for start in (*rules.added, *rules.left_out, *rules.codes):
            assert any(text.startswith(start) for text in texts), f"{name}: no command begins with {start}"


@pytest.mark.parametrize(
    ("shown", "printed", "agree"),
    [
        ("p_free  0.91", "p_free 0.93\n", True),
        ("p_free  0.91", "p_free 0.41\n", False),
        ("8,000 beams... done", "8,100 beams, a note\n and done", True),
        ("8,000 beams", "8,000 cones", False),
        ("8,000 beams", "12,000 beams", False),
    ],
)
def test_what_is_shown_is_compared(shown: str, printed: str, agree: bool) -> None:
    assert (differences(shown, printed, 0.1) is None) == agree
