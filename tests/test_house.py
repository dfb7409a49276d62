"""What every module obeys, read from its source alone: no import circle, one class a name, limits of size.

Nothing of the packages is imported, so that `make check` has the answer in seconds.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("prf", "mapq")
SOURCES = (*PACKAGES, "benchmarks", "docs")
MODULE_LINES, FUNCTION_LINES = 400, 60
"""At most; a docstring is not counted among the lines of its function."""
HEAVY = {"numba", "scipy", "sklearn", "matplotlib", "shapely"}
"""What takes longer to import than `--help` may take."""

Graph = dict[str, set[str]]
package_by_package = pytest.mark.parametrize("package", PACKAGES)


@cache
def modules(package: str) -> dict[str, tuple[Path, ast.Module]]:
    """Return path and syntax tree of the modules below a folder, by their dotted names."""
    found = {}
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = path, ast.parse(path.read_text(encoding="utf-8"))
    return found


def is_for_type_checkers(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def import_nodes(node: ast.AST, at_import: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """Yield the imports that run: all of them, or those alone that run when the module is imported."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child
        elif is_for_type_checkers(child):
            assert isinstance(child, ast.If)
            yield from (each for part in child.orelse for each in import_nodes(part, at_import))
        elif not (at_import and isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)):
            yield from import_nodes(child, at_import)


def imported(name: str, package: str, at_import: bool = False) -> set[str]:
    """Return the names of all that a module imports, those of modules of `package` in full."""
    path, tree = modules(package)[name]
    found = set()
    for node in import_nodes(tree, at_import):
        if isinstance(node, ast.Import):
            found |= {each.name for each in node.names}
            continue
        base = node.module or ""
        if node.level:
            above = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
            base = ".".join([*above[: len(above) - node.level + 1], *([base] if base else [])])
        names = {f"{base}.{each.name}" for each in node.names}
        found |= {each if each in modules(package) else base for each in names}
    return found


def import_graph(package: str) -> Graph:
    """Return what each module imports of its own package, inside functions too."""
    return {name: (imported(name, package) & modules(package).keys()) - {name} for name in modules(package)}


def circles(graph: Graph) -> list[list[str]]:
    """Return the sets of modules that reach each other (Tarjan's strongly connected components)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        order[name] = low[name] = len(order)
        stack.append(name)
        for other in sorted(graph[name]):
            if other not in order:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == order[name]:
            circle = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            if len(circle) > 1:
                found.append(sorted(circle))

    for name in graph:
        if name not in order:
            visit(name)
    return found


def class_names(package: str) -> dict[str, list[str]]:
    """Return the modules that define a class of each name."""
    found = defaultdict(list)
    for name, (_, tree) in modules(package).items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                found[node.name].append(name)
    return found


def function_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines of a function without its docstring."""
    first = node.body[0]
    is_words = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    return _lines(node) - (_lines(first) if is_words and ast.get_docstring(node) else 0)


def _lines(node: ast.stmt) -> int:
    assert node.end_lineno is not None
    return node.end_lineno - node.lineno + 1


def reached(start: str, package: str) -> set[str]:
    """Return all that is imported when a module is."""
    seen, rest = set(), {start}
    while rest:
        name = rest.pop()
        seen.add(name)
        if name in modules(package):
            above = {name.rsplit(".", k)[0] for k in range(1, name.count(".") + 1)}
            rest |= (imported(name, package, at_import=True) | above) - seen
    return seen


@package_by_package
def test_no_modules_import_each_other_in_a_circle(package: str) -> None:
    assert circles(import_graph(package)) == []


def test_a_circle_is_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set()}
    assert circles(graph) == [["b", "c"]]


@package_by_package
def test_the_name_of_a_class_is_used_once(package: str) -> None:
    assert {name: homes for name, homes in class_names(package).items() if len(homes) > 1} == {}


@pytest.mark.parametrize("folder", SOURCES)
def test_modules_are_short(folder: str) -> None:
    lines = {name: len(path.read_text().splitlines()) for name, (path, _) in modules(folder).items()}
    assert {name: n for name, n in lines.items() if n > MODULE_LINES} == {}


@pytest.mark.parametrize("folder", [*SOURCES, "data", "tests"])
def test_functions_are_short(folder: str) -> None:
    functions = {
        f"{name}.{node.name}": function_lines(node)
        for name, (_, tree) in modules(folder).items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    assert {name: n for name, n in functions.items() if n > FUNCTION_LINES} == {}


@package_by_package
def test_command_lines_start_without_what_is_slow_to_import(package: str) -> None:
    starts = [name for name in modules(package) if name.startswith(f"{package}.commands") or name == f"{package}.cli"]
    slow = {start: {name.split(".")[0] for name in reached(start, package)} & HEAVY for start in starts}
    assert {start: names for start, names in slow.items() if names} == {}
