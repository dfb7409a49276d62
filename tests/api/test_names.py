"""`import prf, mapq` is quick, and the names that the two packages lend out are one and the same in every table."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import runpy
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import mapq
import prf

HEAVY = ("numba", "numpy", "scipy", "shapely", "matplotlib", "typer", "rich")
PACKAGES = pytest.mark.parametrize("package", [prf, mapq], ids=["prf", "mapq"])


def seen_by_type_checkers(package: ModuleType) -> set[tuple[str, str]]:
    """Return module and name of each import under TYPE_CHECKING."""
    tree = ast.parse(Path(package.__file__ or "").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    return {(node.module or "", name.name) for node in imports for name in node.names}


def test_importing_both_imports_nothing_heavy(project_root: Path) -> None:
    code = f"import sys, prf, mapq; dir(prf), dir(mapq); print(*sorted(set({HEAVY!r}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=project_root)
    assert (done.returncode, done.stdout, done.stderr) == (0, "\n", "")


@PACKAGES
def test_type_checkers_see_what_is_imported(package: ModuleType) -> None:
    homes = {(module, name) for module, names in package._HOMES.items() for name in names}
    assert seen_by_type_checkers(package) == homes
    assert package.__all__ == sorted({name for _, name in homes}, key=lambda name: (name[0].islower(), name))


@PACKAGES
def test_every_name_is_there_and_has_words(package: ModuleType) -> None:
    for name in package.__all__:
        assert getattr(package, name).__doc__, name
    assert set(package.__all__) <= set(dir(package))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = package.nonsense


@PACKAGES
def test_no_name_is_that_of_a_module_which_would_hide_it(package: ModuleType) -> None:
    modules = {module.name for module in pkgutil.iter_modules(package.__path__)}
    assert set(package.__all__) & modules == set()
    for module in modules - {"__main__"}:
        importlib.import_module(f"{package.__name__}.{module}")
    assert callable(prf.sample)
    assert callable(mapq.segment)


# docs/examples run as they stand, and what docs/python-api.md shows is cut from them.


EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "docs" / "examples").glob("*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(
    example: Path, data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data").symlink_to(data_dir)
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(example), run_name="__main__")
    said = capsys.readouterr()
    assert said.out.count("\n") >= 2
    assert "error" not in said.err.lower()


def test_the_page_shows_what_runs(project_root: Path) -> None:
    page = (project_root / "docs" / "python-api.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    sources = [path.read_text() for path in EXAMPLES]
    assert len(blocks) >= 6
    assert [block for block in blocks if not any(block.strip() in source for source in sources)] == []
    for path in EXAMPLES:
        assert f"](examples/{path.name})" in page


def test_the_page_names_everything(project_root: Path) -> None:
    import mapq
    import prf

    page = (project_root / "docs" / "python-api.md").read_text()
    missing = [f"{tool.__name__}.{name}" for tool in (prf, mapq) for name in tool.__all__]
    assert [name for name in missing if f"`{name}" not in page] == []
