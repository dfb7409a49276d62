"""The recipes in docs/examples: files that Docker, GitHub and GitLab take, whose commands run as they stand."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.docs.brought import make_cloud, make_log, make_route
from tests.packaging.container import instructions

yaml = pytest.importorskip("yaml", reason="needs PyYAML, which distributed brings")
SYSTEMS = ("github-actions", "gitlab-ci")


def jobs_of(system: str) -> dict[str, tuple[list[str], list[str]]]:
    """Return of each job of a recipe the shell commands, and the files that it keeps."""
    content = yaml.safe_load((ROOT / "docs" / "examples" / f"{system}.yml").read_text())
    if system == "gitlab-ci":
        assert set(content.pop("default")) <= {"image", "timeout", "cache"}
        assert all(isinstance(value, str) for value in content.pop("variables").values())
        assert all(set(job) <= {"script", "after_script", "artifacts"} for job in content.values())
        return {
            name: (job["script"] + job.get("after_script", []), job["artifacts"]["paths"])
            for name, job in content.items()
        }
    assert set(content) == {"name", True, "env", "jobs"}  # "on" is a truth value to YAML 1.1, and a key to GitHub
    assert all(set(job) == {"runs-on", "timeout-minutes", "steps"} for job in content["jobs"].values())
    found = {name: job["steps"] for name, job in content["jobs"].items()}
    for step in (step for steps in found.values() for step in steps):
        assert set(step) in ({"run"}, {"run", "if"}, {"uses", "with"}, {"uses", "with", "if"})
        assert re.fullmatch(r"actions/[a-z-]+@v\d", step.get("uses", "actions/checkout@v4"))
    return {
        name: ([step["run"] for step in steps if "run" in step], steps[-1]["with"]["path"].split())
        for name, steps in found.items()
    }


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_recipe_has_the_form_of_its_system(system: str) -> None:
    jobs = jobs_of(system)
    assert set(jobs) == {"cloud", "route"}
    for commands, kept in jobs.values():
        assert commands[0].startswith('python -m pip install "$(ls tools/prf_mapq-*.whl)')
        assert all(isinstance(word, str) for word in (*commands, *kept))


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
def test_the_commands_of_a_recipe_run(tmp_path: Path, system: str) -> None:
    for folder in ("bin", "maps"):
        (tmp_path / folder).mkdir()
    for tool in ("prf", "mapq"):
        (tmp_path / "bin" / tool).write_text(f'#!/bin/sh\nexec {sys.executable} -m {tool} "$@"\n')
        (tmp_path / "bin" / tool).chmod(0o755)
    for make, file in ((make_cloud, "city.ply"), (make_log, "office.log.gz"), (make_route, "route.csv")):
        make(tmp_path / "maps" / file)
    path = os.pathsep.join([str(tmp_path / "bin"), str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    for commands, kept in jobs_of(system).values():
        for command in commands[1:]:
            quick = command.replace("--time-budget 10m", "--steps 10000 --chains 2")
            done = subprocess.run(
                ["bash", "-ec", quick], cwd=tmp_path, env=environment, capture_output=True, check=False
            )
            says_no = "--fail-over" in command or command.startswith("python -c")
            assert done.returncode in ((0, 1) if says_no else (0,)), (command, done.stderr)
        assert [file for file in kept if not (tmp_path / file).is_file()] == []


def test_the_image_is_built_without_a_network_and_run_by_a_user() -> None:
    steps = instructions()
    words = [word for word, _ in steps]
    assert words == ["ARG", "FROM", "RUN", "RUN", "USER", "WORKDIR", "ENV", "RUN", "ENTRYPOINT", "CMD"]
    assert "pip install --no-cache-dir --no-index --find-links /wheels " in steps[2][1]
    start = [word for _, rest in steps[-2:] for word in json.loads(rest)]
    done = subprocess.run([sys.executable, *start[1:]], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
