"""What a release holds, and which versions of its dependencies the project states."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email.parser import BytesParser
from pathlib import Path

import pytest

import prf
from tests.conftest import ROOT

MINIMUM = Path(__file__).with_name("minimum.txt")
NEWEST = ROOT / "constraints.txt"
UNTESTED = {"all", "bench", "docs"}
"""Extras that name other extras, or that only benchmarks or the site use."""
INFO = f"prf_mapq-{prf.__version__}.dist-info"


def build(target: str, folder: Path, source: Path = ROOT) -> Path:
    """Build a wheel or an sdist of a source tree with hatchling."""
    pytest.importorskip("hatchling", reason="needs hatchling (pip install '.[dev]')")
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return next(folder.glob({"wheel": "*.whl", "sdist": "*.tar.gz"}[target]))


def tracked(*folders: str) -> set[str]:
    """Return the files that git tracks below these folders, or skip."""
    if not (ROOT / ".git").exists():
        pytest.skip("needs git's list of files")
    done = subprocess.run(["git", "ls-files", "-z", *folders], cwd=ROOT, capture_output=True, text=True, check=True)
    return {name for name in done.stdout.split("\0") if name and (ROOT / name).exists()}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", tmp_path_factory.mktemp("wheel"))


def test_the_wheel_holds_the_two_packages_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        found = {name for name in archive.namelist() if not name.startswith(f"{INFO}/")}
        metadata = BytesParser().parsebytes(archive.read(f"{INFO}/METADATA"))
        scripts = archive.read(f"{INFO}/entry_points.txt").decode().splitlines()
        assert archive.read(f"{INFO}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
    assert found >= tracked("prf", "mapq")
    assert {name.partition("/")[0] for name in found} == {"prf", "mapq"}
    assert not [name for name in found if "__pycache__" in name or name.endswith((".pyc", ".nbc", ".nbi"))]
    assert {"prf/py.typed", "mapq/py.typed", "mapq/models/default.json", "mapq/report/assets/report.html"} <= found
    assert (metadata["Name"], metadata["Version"]) == ("prf-mapq", prf.__version__)
    assert metadata["License-Expression"] == "GPL-3.0-or-later"
    assert metadata.get_payload() == (ROOT / "README.md").read_text(encoding="utf-8")
    assert {"prf = prf.__main__:main", "mapq = mapq.__main__:main"} <= set(scripts)


@pytest.mark.slow
def test_the_source_archive_is_complete_and_builds_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    archive = build("sdist", tmp_path)
    with tarfile.open(archive) as opened:
        assert {member.name.partition("/")[2] for member in opened if member.isfile()} >= {"PKG-INFO", *tracked()}
    shutil.unpack_archive(archive, tmp_path / "source")
    (source,) = (tmp_path / "source").iterdir()
    assert build("wheel", tmp_path / "again", source).read_bytes() == wheel.read_bytes()


def declared() -> dict[str, str]:
    """Return the lower bounds of the dependencies and of the extras that tests need, by distribution."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(one for name in extras if name not in UNTESTED for one in extras[name])]
    parts = [re.fullmatch(r"([\w.-]+)>=([\d.]+)(?:,.*)?", one) for one in wanted]
    assert all(parts), wanted
    return {part[1]: part[2] for part in parts if part}


def pinned(path: Path) -> dict[str, str]:
    """Return the versions that a constraints file pins."""
    lines = [line.partition("#")[0].strip() for line in path.read_text().splitlines()]
    return dict(line.split("==") for line in lines if line)


def numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.removesuffix(".*").split("."))


def test_the_oldest_versions_tested_are_the_lower_bounds() -> None:
    assert pinned(MINIMUM) == declared()


def test_the_newest_versions_are_pinned_and_allowed() -> None:
    newest, lowest = pinned(NEWEST), declared()
    assert set(newest) == set(lowest)
    for name, version in newest.items():
        parts = numbers(version)
        assert parts >= numbers(lowest[name])[: len(parts)], name


def test_every_test_that_coverage_runs_uncompiled_exists() -> None:
    for name in (ROOT / "tests" / "uncompiled.txt").read_text().splitlines()[2:]:
        file, _, test = name.partition("::")
        assert (ROOT / file).is_file(), name
        assert all(part.partition("[")[0] in (ROOT / file).read_text() for part in test.split("::")), name
