"""What no reader may do: run what a file says, or write where an archive says."""

from __future__ import annotations

import ast
import functools
from pathlib import Path

import pytest

BETWEEN_WORKERS = "prf/sampler/distributed.py"
"""Readings on their way to workers of the same run, which Dask pickles too; no file is read so."""


def modules(root: Path) -> list[Path]:
    return [file for package in ("prf", "mapq") for file in sorted((root / package).rglob("*.py"))]


@functools.cache
def calls(file: Path) -> list[tuple[str, ast.Call]]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return [(ast.unparse(node.func), node) for node in ast.walk(tree) if isinstance(node, ast.Call)]


def test_nothing_is_unpickled_from_a_file(project_root):
    for file in modules(project_root):
        if file != project_root / BETWEEN_WORKERS:
            names = {name for name, _ in calls(file)}
            assert not {
                name for name in names if name.startswith(("pickle.", "joblib.", "dill.", "marshal.", "shelve."))
            }
        for name, call in calls(file):
            pickled = [word for word in call.keywords if word.arg == "allow_pickle"]
            assert all(isinstance(word.value, ast.Constant) and word.value.value is False for word in pickled), name


@pytest.mark.parametrize(
    "forbidden", ["eval", "exec", "compile", "__import__", "os.system", "yaml.load", "yaml.unsafe_load"]
)
def test_nothing_is_run_that_a_file_says(project_root, forbidden):
    assert [file for file in modules(project_root) for name, _ in calls(file) if name == forbidden] == []


def imports(file: Path) -> set[str]:
    """Return the modules that a file imports, anywhere in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add((node.module or "").partition(".")[0])
    return found


def test_no_module_can_unpickle_or_unpack(project_root):
    for file in modules(project_root):
        allowed = {"pickle"} if file == project_root / BETWEEN_WORKERS else set()
        assert imports(file) & {"pickle", "dill", "joblib", "marshal", "shelve", "tarfile"} <= allowed, file


def test_no_shell_and_no_unsafe_yaml(project_root):
    for file in modules(project_root):
        for name, call in calls(file):
            words = {word.arg: word.value for word in call.keywords}
            assert "shell" not in words, (file, name)
            if name.endswith("YAML"):
                assert ast.unparse(words["typ"]) == "'safe'", (file, name)
            assert not name.startswith(("os.popen", "os.spawn", "os.exec", "yaml.full_load")), (file, name)


def test_no_archive_is_unpacked_to_the_disk(project_root):
    ends = (".extractall", ".extract", "unpack_archive")
    found = [(file, name) for file in modules(project_root) for name, _ in calls(file) if name.endswith(ends)]
    assert found == []
    assert not [file for file in modules(project_root) if "import tarfile" in file.read_text(encoding="utf-8")]
