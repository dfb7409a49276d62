"""Small mistakes in a source: an operator, a constant, a comparison, a branch or a term altered, each on its own."""

from __future__ import annotations

import ast
import itertools
from collections.abc import Iterator
from typing import NamedTuple

OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Add,
    ast.Pow: ast.Mult,
    ast.MatMult: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr,
}
OPPOSITES: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
BORDERS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}
"""Comparisons that differ at equality alone."""
FUNCTIONS = {
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "argmin": "argmax",
    "argmax": "argmin",
    "any": "all",
    "all": "any",
    "floor": "ceil",
    "ceil": "floor",
    "sin": "cos",
    "cos": "sin",
    "ones": "zeros",
    "zeros": "ones",
}
DROPPED = {"abs", "fabs", "exp", "log", "sqrt"}
"""Functions of one number that a mistake leaves out."""
TESTED = (ast.If, ast.IfExp, ast.While)


class Mistake(NamedTuple):
    """A stretch of a source and what stands there instead.

    Attributes
    ----------
    function : str
        Qualified name of where it is, ``<module>`` outside of functions.
    before, after : str
        The whole lines, blanks as one.
    start, end : int
        The stretch, in bytes of the source.
    text : str
        In its place.
    earlier : int
        Where a line stands again further down in its function, which one it is, from 1 on; 0 for the last.
    """

    function: str
    before: str
    after: str
    start: int
    end: int
    text: str
    earlier: int = 0

    def __str__(self) -> str:
        which = f" (line {self.earlier} of those alike)" if self.earlier else ""
        return f"{self.function}: {self.before} -> {self.after}{which}"


class Edit(NamedTuple):
    """A node and what takes its place."""

    function: str
    node: ast.expr | ast.stmt
    text: str


def mistakes(source: str, *, borders: bool) -> list[Mistake]:
    """Return the mistakes that can be made in a source.

    Parameters
    ----------
    source : str
    borders : bool
        Whether a comparison that differs at equality alone is one: it is where labels tie, and not between numbers
        that are drawn from a continuous law.
    """
    edits = _edits(ast.parse(source), "<module>", borders)
    placed = {(one.start, one.end, one.text): one for one in (_placed(source, edit) for edit in edits)}
    alike: dict[str, list[Mistake]] = {}
    for mistake in placed.values():
        alike.setdefault(str(mistake), []).append(mistake)
    for same in alike.values():
        same[:-1] = [mistake._replace(earlier=number) for number, mistake in enumerate(same[:-1], 1)]
    return list(itertools.chain.from_iterable(alike.values()))


def altered(source: str, mistake: Mistake) -> str:
    """Return the source with the mistake in it."""
    encoded = source.encode()
    return (encoded[: mistake.start] + mistake.text.encode() + encoded[mistake.end :]).decode()


def _placed(source: str, edit: Edit) -> Mistake:
    """Return where an edit falls in the source, and the lines that it changes."""
    lines = source.encode().splitlines(keepends=True)
    first, last = edit.node.lineno - 1, (edit.node.end_lineno or 0) - 1
    offset = sum(map(len, lines[:first]))
    start = offset + edit.node.col_offset
    end = sum(map(len, lines[:last])) + (edit.node.end_col_offset or 0)
    length = sum(map(len, lines[first : last + 1]))
    whole = source.encode()[offset : offset + length]
    changed = whole[: start - offset] + edit.text.encode() + whole[end - offset :]
    return Mistake(edit.function, _one_line(whole), _one_line(changed), start, end, edit.text)


def _one_line(text: bytes) -> str:
    return " ".join(text.decode().split())


def _edits(node: ast.AST, function: str, borders: bool) -> Iterator[Edit]:
    """Yield the edits of a node and of all below it."""
    if isinstance(node, ast.expr | ast.stmt):
        for text in _texts(node, borders):
            yield Edit(function, node, text)
    if isinstance(node, TESTED) and isinstance(node.test, ast.Name | ast.Call | ast.Attribute | ast.Subscript):
        yield Edit(function, node.test, f"(not {ast.unparse(node.test)})")
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        function = node.name if function == "<module>" else f"{function}.{node.name}"
    for child in _children(node):
        yield from _edits(child, function, borders)


def _children(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what makes numbers: no annotations, decorators, imports, checks or messages of errors."""
    match node:
        case ast.Import() | ast.ImportFrom() | ast.Raise() | ast.Assert() | ast.JoinedStr():
            return
        case ast.keyword(arg="strict"):
            return
        case ast.Tuple(elts=[ast.Constant(value=False) as refused, *_]):
            yield refused  # of a proposal that is not made no other number is read
        case ast.FunctionDef():
            yield from (*node.args.defaults, *(one for one in node.args.kw_defaults if one), *node.body)
        case ast.ClassDef():
            yield from node.body
        case ast.AnnAssign():
            if node.value:
                yield node.value
        case _:
            yield from ast.iter_child_nodes(node)


def _texts(node: ast.expr | ast.stmt, borders: bool) -> Iterator[str]:
    """Yield what may stand in place of a node by mistake."""
    match node:
        case ast.BinOp():
            yield from _of_operator(node)
        case ast.AugAssign():
            yield ast.unparse(ast.AugAssign(node.target, OPERATORS[type(node.op)](), node.value))
            yield "pass"
        case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert()):
            yield _nested(node.operand)
        case ast.Compare():
            yield from _of_comparison(node, borders)
        case ast.BoolOp():
            other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield _nested(ast.BoolOp(other, node.values))
        case ast.Constant():
            yield from _of_constant(node.value)
        case ast.Call():
            yield from _of_call(node)
        case ast.Expr(value=ast.Call()):
            yield "pass"


def _of_operator(node: ast.BinOp) -> Iterator[str]:
    """Another operator, or the right operand left out."""
    yield _nested(ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right))
    yield _nested(node.left)
    if isinstance(node.op, ast.Mult | ast.Add):
        yield _nested(node.right)


def _of_comparison(node: ast.Compare, borders: bool) -> Iterator[str]:
    for table in (OPPOSITES, BORDERS) if borders else (OPPOSITES,):
        for place, operator in enumerate(node.ops):
            other = table.get(type(operator))
            if other is not None:
                yield _nested(
                    ast.Compare(node.left, [*node.ops[:place], other(), *node.ops[place + 1 :]], node.comparators)
                )


def _of_constant(value: object) -> Iterator[str]:
    match value:
        case bool():
            yield str(not value)
        case int():
            yield str(value + 1)
        case float():
            yield repr(2.0 * value if value else 1.0)


def _of_call(node: ast.Call) -> Iterator[str]:
    """Its counterpart, or the argument itself."""
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if name in FUNCTIONS:
        other = FUNCTIONS[name]
        function = ast.Attribute(node.func.value, other) if isinstance(node.func, ast.Attribute) else ast.Name(other)
        yield ast.unparse(ast.Call(function, node.args, node.keywords))
    if name in DROPPED and len(node.args) == 1:
        yield _nested(node.args[0])


def _nested(node: ast.expr) -> str:
    return f"({ast.unparse(node)})"
