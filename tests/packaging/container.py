"""The Dockerfile of docs/examples, and its commands in a virtual environment in place of an image."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

from tests.conftest import ROOT

DOCKERFILE = ROOT / "docs" / "examples" / "Dockerfile"
NOT_RUN = re.compile(r"--mount=\S+|useradd [^&]*&&|&& chown [^&]*")
"""What only the building of an image can do."""


def instructions() -> list[tuple[str, str]]:
    """Return the instructions: word and rest, with lines joined."""
    lines = [line for line in DOCKERFILE.read_text().splitlines() if line and not line.startswith("#")]
    joined = "\n".join(lines).replace("\\\n", "").splitlines()
    return [(word, " ".join(rest.split())) for word, _, rest in (line.partition(" ") for line in joined)]


def fault_of_container(folder: Path, python: str) -> str | None:
    """Return what fails of: wheels as the file's head says, its RUN lines, and the call that it ends on."""
    (folder / "data").mkdir(parents=True)
    subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
    there = {"/wheels": folder / "wheels", "/data": folder / "data", "/var/cache/kernels": folder / "cache"}
    environment = {"PATH": f"{folder / 'venv' / 'bin'}:/usr/bin:/bin", "HOME": str(folder)}

    def moved(text: str) -> str:
        return re.sub("|".join(there), lambda found: str(there[found[0]]), text)

    def run(command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["sh", "-ec", command], cwd=folder / "data", env=environment, capture_output=True, text=True, check=False
        )

    commands = [f"python -m pip wheel --quiet --wheel-dir {folder / 'wheels'} '{ROOT}[all]'"]
    for word, rest in instructions():
        if word == "ENV":
            environment |= dict(part.split("=", 1) for part in moved(rest).split())
        elif word == "RUN":
            commands.append(moved(NOT_RUN.sub("", rest)))
    steps = dict(instructions())
    commands.append(" ".join(json.loads(steps["ENTRYPOINT"]) + json.loads(steps["CMD"])))
    for command in commands:
        done = run(command)
        if done.returncode != 0:
            return f"{command}: {done.stderr.strip()}"
    empty = [tool for tool in ("prf", "mapq") if not list((folder / "cache" / tool).rglob("*.nbc"))]
    return f"no kernels are compiled for {empty}" if empty else None
