"""The Dockerfile of docs/examples, and its commands in a virtual environment in place of an image."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

from tests.conftest import ROOT

NOT_RUN = re.compile(r"--mount=\S+|useradd [^&]*&&|&& chown [^&]*")
"""What only the building of an image can do."""


def instructions() -> list[tuple[str, str]]:
    """Return the instructions of the Dockerfile: word and rest, with lines joined."""
    text = (ROOT / "docs" / "examples" / "Dockerfile").read_text()
    lines = re.sub(r"^#.*\n|\\\n", "", text, flags=re.MULTILINE).splitlines()
    return [(word, " ".join(rest.split())) for word, _, rest in (line.partition(" ") for line in lines if line)]


def fault_of_container(folder: Path, python: str) -> str | None:
    """Return what fails of: wheels as the file's head says, its RUN lines, and the call that it ends on."""
    (folder / "data").mkdir(parents=True)
    subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
    environment = {"PATH": f"{folder / 'venv' / 'bin'}:/usr/bin:/bin", "HOME": str(folder)}
    commands = [f"python -m pip wheel --quiet --wheel-dir {folder}/wheels '{ROOT}[all]'"]
    steps = [(word, re.sub("(?=/(wheels|data|var/cache/))", str(folder), rest)) for word, rest in instructions()]
    for word, rest in steps:
        if word == "ENV":
            environment |= dict(part.split("=", 1) for part in rest.split())
        elif word == "RUN":
            commands.append(NOT_RUN.sub("", rest))
    commands.append(" ".join(word for _, rest in steps[-2:] for word in json.loads(rest)))
    for command in commands:
        done = subprocess.run(
            ["sh", "-ec", command], cwd=folder / "data", env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            return f"{command}: {done.stderr.strip()}"
    empty = [tool for tool in ("prf", "mapq") if not list((folder / "var/cache/kernels" / tool).rglob("*.nbc"))]
    return f"no kernels are compiled for {empty}" if empty else None
