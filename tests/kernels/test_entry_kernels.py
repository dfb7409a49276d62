"""A second process compiles nothing: every kernel that Python calls comes from the cache."""

from __future__ import annotations

import ast
import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

TOOLS = ("prf", "mapq")
PACKAGES = tuple(f"{tool}.kernels" for tool in TOOLS)


def kernels_called_from_python(root: Path) -> set[str]:
    """Return the full names of the kernels that a module outside a tool's `kernels` imports or reads from one."""
    names = set()
    for path in (path for tool in TOOLS for path in (root / tool).rglob("*.py")):
        if any(path.is_relative_to(root / tool / "kernels") for tool in TOOLS):
            continue
        tree = ast.parse(path.read_text())
        modules = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGES):
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
                modules |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
                names.add(f"{modules[node.value.id]}.{node.attr}")
    return {name for name in names if is_kernel(name)}


def is_kernel(name: str) -> bool:
    module, _, attribute = name.rpartition(".")
    try:
        value = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError):
        return False
    return hasattr(value, "stats")


@pytest.fixture(scope="module")
def counts(project_root: Path) -> dict[str, tuple[int, int]]:
    """Return the cache hits and misses of each kernel in a process that found all compiled, or in the second one."""
    for _ in range(2):
        work = [sys.executable, "-m", "tests.warm_kernels"]
        done = subprocess.run(work, cwd=project_root, capture_output=True, check=True, text=True)
        found = {name: (hits, misses) for name, (hits, misses) in json.loads(done.stdout).items()}
        if not any(misses for _, misses in found.values()):
            break
    return found


def test_the_second_process_compiles_nothing(counts: dict[str, tuple[int, int]]) -> None:
    assert counts
    assert {name: count for name, count in counts.items() if count[1] > 0} == {}


def test_every_kernel_that_python_calls_hits_the_cache(counts: dict[str, tuple[int, int]], project_root: Path) -> None:
    entries = kernels_called_from_python(project_root)
    assert entries
    assert {name for name in entries if counts.get(name, (0, 0))[0] == 0} == set()
