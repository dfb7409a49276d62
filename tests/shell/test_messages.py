"""Messages for people hold no names of our code, which a renaming may put there."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

TOOLS = ("prf", "mapq")
SAID_BY = re.compile(r"[A-Z]\w*Error|debug|info|warning|error|emit|Interrupted")
"""Names of what is called with a message."""

SEEN_BY_USERS = {"x_min", "y_min", "x_max", "y_max", "n_chains", "n_draws", "p_suspicious"}
"""Columns, fields and settings that functions are called by too."""


def trees(root: Path) -> Iterator[tuple[Path, ast.Module]]:
    for tool in TOOLS:
        for path in sorted((root / tool).rglob("*.py")):
            yield path.relative_to(root), ast.parse(path.read_text())


def code_names(root: Path) -> set[str]:
    """Return the names of functions and classes of several words, which no prose has by chance."""
    kinds = (ast.FunctionDef, ast.ClassDef)
    names = {node.name for _, tree in trees(root) for node in ast.walk(tree) if isinstance(node, kinds)}
    return {name for name in names - SEEN_BY_USERS if re.search(r"[a-z0-9](_[a-z]|[A-Z])", name)}


def words_said(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and word of every message."""
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        name = getattr(call.func, "id", getattr(call.func, "attr", ""))
        if not SAID_BY.fullmatch(name):
            continue
        for text in (node for given in call.args for node in ast.walk(given) if isinstance(node, ast.Constant)):
            if isinstance(text.value, str) and " " in text.value:
                for word in re.findall(r"(?<![\w.\"'-])\w+(?![\w(=\"'])", text.value):
                    yield text.lineno, word


def found(root: Path) -> list[str]:
    names = code_names(root)
    return [f"{path}:{line}: {word}" for path, tree in trees(root) for line, word in words_said(tree) if word in names]


def test_no_message_holds_a_name_of_the_code(project_root: Path) -> None:
    assert found(project_root) == []


def test_such_a_name_would_be_seen(tmp_path: Path) -> None:
    (tmp_path / "prf").mkdir()
    lines = [
        "class ReadingKind: ...",
        "def f(a):",
        '    raise UsageError(f"{a}: a run is a directory. ReadingKind one.")',
    ]
    (tmp_path / "prf" / "sample.py").write_text("\n".join(lines))
    assert found(tmp_path) == ["prf/sample.py:3: ReadingKind"]
