"""A mistake made in a function that is already imported: its code is exchanged, so that nothing is imported anew."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from types import CodeType, FunctionType

from tests.mutation.mistakes import Mistake, altered


def exchange_code(module: str, source: str, mistake: Mistake) -> bool:
    """Make a mistake in an imported module; return False where it is not in the code of a function.

    Constants of a module, defaults of arguments and fields of classes have gone elsewhere by import: they ask for a
    process that imports the altered source.
    """
    outer = _outermost(module, mistake.function)
    if outer is None:
        return False
    function, name = outer
    path = function.__code__.co_filename
    intact = _code_of(compile(source, path, "exec", dont_inherit=True), name)
    wrong = _code_of(compile(altered(source, mistake), path, "exec", dont_inherit=True), name)
    if intact is None or wrong is None or is_same_code(intact, wrong):
        return False
    if function.__code__.co_freevars != wrong.co_freevars:
        return False
    function.__code__ = wrong
    return True


def is_same_code(one: CodeType, other: CodeType) -> bool:
    """Whether two functions do the same, wherever their sources stand."""
    if (one.co_code, one.co_names, one.co_varnames) != (other.co_code, other.co_names, other.co_varnames):
        return False
    if len(one.co_consts) != len(other.co_consts):
        return False
    return all(_is_same_constant(*pair) for pair in zip(one.co_consts, other.co_consts, strict=True))


def _is_same_constant(one: object, other: object) -> bool:
    if isinstance(one, CodeType) and isinstance(other, CodeType):
        return is_same_code(one, other)
    return repr(one) == repr(other)


def _outermost(module: str, qualified: str) -> tuple[FunctionType, str] | None:
    """Return the function of a module, or the method of a class, that holds a place; and its qualified name."""
    found: object = sys.modules[module]
    passed: list[str] = []
    for name in qualified.split("."):
        found = vars(found).get(name)
        passed.append(name)
        if isinstance(found, property):
            found = found.fget
        elif isinstance(found, staticmethod | classmethod):
            found = found.__func__
        found = getattr(found, "__wrapped__", found)
        if isinstance(found, FunctionType):
            return found, ".".join(passed)
        if not isinstance(found, type):
            return None
    return None


def _code_of(code: CodeType, qualified: str) -> CodeType | None:
    return next((found for found in _codes(code) if found.co_qualname == qualified), None)


def _codes(code: CodeType) -> Iterator[CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from _codes(constant)
