"""What a release holds: everything that runs in the wheel, everything that is needed to work on it in the source."""

from __future__ import annotations

import subprocess
from email.parser import BytesParser
from pathlib import Path

import pytest

import prf
from tests.packaging.archives import ROOT, Archives, build, build_wheel, source_names, unpack, wheel_contents

pytest.importorskip("hatchling", reason="needs hatchling (pip install 'prf-mapq[dev]')")
INFO = f"prf_mapq-{prf.__version__}.dist-info"


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> Archives:
    return build(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def wheel(archives: Archives) -> dict[str, bytes]:
    return wheel_contents(archives.wheel)


def tracked(*folders: str) -> set[str]:
    """Files that git knows below these folders (all: none given), or skip."""
    if not (ROOT / ".git").exists():
        pytest.skip("needs the files' list of git")
    done = subprocess.run(["git", "ls-files", "-z", *folders], cwd=ROOT, capture_output=True, text=True, check=True)
    return {name for name in done.stdout.split("\0") if name and (ROOT / name).exists()}


def test_the_wheel_holds_the_two_packages_whole_and_nothing_else(wheel: dict[str, bytes]) -> None:
    found = {name for name in wheel if not name.startswith(f"{INFO}/")}
    assert found >= tracked("prf", "mapq")
    assert {name.partition("/")[0] for name in found} == {"prf", "mapq"}
    assert not [name for name in found if "__pycache__" in name or name.endswith((".pyc", ".nbc", ".nbi"))]


def test_the_wheel_holds_what_is_no_python(wheel: dict[str, bytes]) -> None:
    needed = {"prf/py.typed", "mapq/py.typed", "mapq/models/default.json", "mapq/report/assets/report.html"}
    assert needed <= set(wheel)
    assert wheel[f"{INFO}/licenses/LICENSE"] == (ROOT / "LICENSE").read_bytes()


def test_the_wheel_says_what_it_is(wheel: dict[str, bytes]) -> None:
    said = BytesParser().parsebytes(wheel[f"{INFO}/METADATA"])
    assert (said["Name"], said["Version"], said["License-Expression"]) == (
        "prf-mapq",
        prf.__version__,
        "GPL-3.0-or-later",
    )
    assert said.get_payload() == (ROOT / "README.md").read_text(encoding="utf-8")
    scripts = wheel[f"{INFO}/entry_points.txt"].decode().split("\n")
    assert {"prf = prf.__main__:main", "mapq = mapq.__main__:main"} <= set(scripts)
    assert b"Root-Is-Purelib: true" in wheel[f"{INFO}/WHEEL"]


def test_the_source_holds_everything_that_git_holds(archives: Archives) -> None:
    found = source_names(archives.source)
    assert found >= {"LICENSE", "README.md", "CHANGELOG.md", "Makefile", "constraints.txt", "PKG-INFO"}
    assert found >= tracked()


def test_the_source_builds_the_same_wheel(archives: Archives, tmp_path: Path) -> None:
    source = unpack(archives.source, tmp_path / "source")
    again = build_wheel(source, tmp_path / "dist")
    assert again.name == archives.wheel.name
    assert again.read_bytes() == archives.wheel.read_bytes()
