"""The recipes in docs/examples: files that Docker, GitHub and GitLab take, whose commands run as they stand."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT
from tests.docs.brought import make_cloud, make_log, make_route
from tests.packaging.container import instructions

yaml = pytest.importorskip("yaml", reason="needs PyYAML, which distributed brings")
RECIPES = ROOT / "docs" / "examples"
STEP_KEYS = {"name", "uses", "with", "run", "if"}
JOB_KEYS = {
    "github-actions": {"runs-on", "timeout-minutes", "steps"},
    "gitlab-ci": {"script", "after_script", "artifacts"},
}


def jobs_of(system: str) -> dict[str, Any]:
    """Return the jobs of a recipe by name."""
    content = yaml.safe_load((RECIPES / f"{system}.yml").read_text())
    if system == "github-actions":  # "on" is a truth value to YAML 1.1, and a key to GitHub
        assert set(content) == {"name", True, "env", "jobs"}
        return dict(content["jobs"])
    assert set(content["default"]) <= {"image", "timeout", "cache"}
    return {name: job for name, job in content.items() if name not in ("default", "variables")}


def commands_of(system: str, job: dict[str, Any]) -> Iterator[str]:
    """Yield the shell commands of a job in their order; what is no step of that system fails."""
    for step in job.get("steps", ()):
        assert set(step) <= STEP_KEYS
        assert ("uses" in step) != ("run" in step)
        assert re.fullmatch(r"actions/[a-z-]+@v\d", step.get("uses", "actions/checkout@v4"))
        yield from [step["run"]] if "run" in step else []
    yield from (*job.get("script", ()), *job.get("after_script", ()))


def kept_by(job: dict[str, Any]) -> list[str]:
    """Return the files that a job keeps."""
    uploads = [step["with"]["path"].split() for step in job.get("steps", ()) if "upload" in step.get("uses", "")]
    return list(job["artifacts"]["paths"] if "artifacts" in job else uploads[0])


@pytest.mark.parametrize("system", JOB_KEYS)
def test_a_recipe_has_the_form_of_its_system(system: str) -> None:
    jobs = jobs_of(system)
    assert set(jobs) == {"cloud", "route"}
    for job in jobs.values():
        assert set(job) <= JOB_KEYS[system]
        commands = list(commands_of(system, job))
        assert all(isinstance(command, str) for command in commands)
        assert commands[0].startswith('python -m pip install "$(ls tools/prf_mapq-*.whl)')


@pytest.mark.slow
@pytest.mark.parametrize(("system", "name"), [(system, job) for system in JOB_KEYS for job in ("cloud", "route")])
def test_the_commands_of_a_recipe_run(tmp_path: Path, system: str, name: str) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "maps").mkdir()
    for tool in ("prf", "mapq"):
        (tmp_path / "bin" / tool).write_text(f'#!/bin/sh\nexec {sys.executable} -m {tool} "$@"\n')
        (tmp_path / "bin" / tool).chmod(0o755)
    for make, file in ((make_cloud, "city.ply"), (make_log, "office.log.gz"), (make_route, "route.csv")):
        make(tmp_path / "maps" / file)
    path = os.pathsep.join([str(tmp_path / "bin"), str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    job = jobs_of(system)[name]
    for command in list(commands_of(system, job))[1:]:
        quick = command.replace("--time-budget 10m", "--steps 10000 --chains 2")
        done = subprocess.run(["bash", "-ec", quick], cwd=tmp_path, env=environment, capture_output=True, check=False)
        says_no = "--fail-over" in command or command.startswith("python -c")
        assert done.returncode in ((0, 1) if says_no else (0,)), (command, done.stderr)
    assert [file for file in kept_by(job) if not (tmp_path / file).is_file()] == []


def test_the_image_is_built_without_a_network_and_run_by_a_user() -> None:
    steps = instructions()
    words = [word for word, _ in steps]
    assert set(words) <= {"ARG", "FROM", "RUN", "USER", "WORKDIR", "ENV", "ENTRYPOINT", "CMD"}
    assert words[:2] == ["ARG", "FROM"]
    runs = [rest for word, rest in steps if word == "RUN"]
    assert [run for run in runs if "pip" in run and "--no-index --find-links /wheels" not in run] == []
    assert steps.index(("USER", "maps")) < words.index("ENTRYPOINT")
    start = [word for name in ("ENTRYPOINT", "CMD") for word in json.loads(dict(steps)[name])]
    done = subprocess.run([sys.executable, *start[1:]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
