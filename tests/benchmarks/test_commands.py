"""The options that benchmarks give to `prf` are options that it has."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import prf.cli
from benchmarks import commands
from prf.configuration import Configuration

TREES = {path.stem: ast.parse(path.read_text()) for path in Path(commands.__file__).parent.glob("*.py")}
CALLS = ("prf", "made", "commands.prf", "commands.made")
SETTINGS = {f"{table}.{key}" for table, model in Configuration.tables().items() for key in model.model_fields}


def tables_named(name: str, function: ast.AST, module: str) -> Iterator[ast.Dict]:
    """Yield the dictionaries assigned to a name, or returned by a property: in the function, its module or anywhere."""
    for scope in (function, TREES[module], *TREES.values()):
        found = []
        for node in ast.walk(scope):
            if isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                found += [node.value] if name in map(ast.unparse, targets) else []
            elif isinstance(node, ast.FunctionDef) and node.name == name:
                found += [each.value for each in node.body if isinstance(each, ast.Return)]
        yield from (each for each in found if isinstance(each, ast.Dict))
        if found:
            return


def option_names(node: ast.expr, *scope: Any) -> Iterator[str]:
    """Yield the keys of what is passed with `**`: a literal, a name, an attribute or an entry of a table."""
    match node:
        case ast.Dict():
            for key, value in zip(node.keys, node.values, strict=True):
                if key is None:
                    yield from option_names(value, *scope)
                elif isinstance(key, ast.Constant):
                    yield str(key.value)
        case ast.IfExp():
            yield from (*option_names(node.body, *scope), *option_names(node.orelse, *scope))
        case ast.Name(id=name) | ast.Attribute(attr=name):
            for table in tables_named(name, *scope):
                yield from option_names(table, *scope)
        case ast.Subscript(value=ast.Name(id=name)):
            for table in tables_named(name, *scope):
                yield from (each for value in table.values for each in option_names(value, *scope))


def calls() -> Iterator[tuple[str, str, set[str]]]:
    """Yield module and function, verb and option names of each call of `prf` or `made` with a verb."""
    for module, tree in TREES.items():
        for function in tree.body:
            for node in ast.walk(function):
                if (
                    isinstance(node, ast.Call)
                    and ast.unparse(node.func) in CALLS
                    and isinstance(node.args[0], ast.Constant)
                ):
                    passed = ast.Dict(
                        [ast.Constant(each.arg) if each.arg else None for each in node.keywords],
                        [each.value for each in node.keywords],
                    )
                    names = set(option_names(passed, function, module))
                    yield f"{module}.{getattr(function, 'name', '')}", str(node.args[0].value), names


def test_benchmarks_give_options_that_prf_has() -> None:
    unknown = []
    for place, verb, names in calls():
        options = {option for parameter in prf.cli.app.get_command(None, verb).params for option in parameter.opts}
        flags = {"--" + name.replace("_", "-"): name for name in names if "." not in name}
        unknown += [(place, verb, flag) for flag in set(flags) - options]
        unknown += [(place, verb, name) for name in names - set(flags.values()) - SETTINGS]
    assert unknown == []


def test_every_call_is_read() -> None:
    found = {(place, verb): names for place, verb, names in calls()}
    assert {"laser", "every_scan", "skip_scans", "max_range", "grid.method"} <= found["scores.grids", "grid"]
    assert {"laser.noise", "scale", "time_budget"} <= found["scores.sampled", "sample"]
    assert {"chains", "sampler.tiles", "laser.noise"} <= found["tiles.mapped", "sample"]
