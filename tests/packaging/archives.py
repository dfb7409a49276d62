"""The wheel and the source archive of the project, and what stands in them."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]


class Archives(NamedTuple):
    """The two files that a release consists of."""

    wheel: Path
    source: Path


def build_wheel(source: Path, folder: Path) -> Path:
    """Build the wheel of a source tree into `folder`, with the hatchling that is installed here."""
    _hatch(source, "wheel", folder)
    return _only(folder, "*.whl")


def build(folder: Path) -> Archives:
    """Build both archives of this tree into `folder`."""
    wheel = build_wheel(ROOT, folder)
    _hatch(ROOT, "sdist", folder)
    return Archives(wheel, _only(folder, "*.tar.gz"))


def unpack(source: Path, folder: Path) -> Path:
    """Unpack a source archive and return the folder that it holds."""
    shutil.unpack_archive(source, folder)  # `tarfile` knows filters from Python 3.11.4 on only
    return _only(folder, "*")


def wheel_contents(wheel: Path) -> dict[str, bytes]:
    """Return name to content of the files in a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def source_names(source: Path) -> set[str]:
    """Return the files of a source archive, below its one folder."""
    with tarfile.open(source) as archive:
        return {member.name.partition("/")[2] for member in archive if member.isfile()}


def _hatch(source: Path, target: str, folder: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def _only(folder: Path, pattern: str) -> Path:
    (found,) = folder.glob(pattern)
    return found
