"""Parts of kernels that are optimised once, in the kernel that calls them.

Numba optimises every function with all that it calls, and makes machine code of the whole, again at each level of
calls, although of a part that Python never calls none of this is used. Here a part is lowered and linked only; the
entries that call it, directly or not, optimise its code. That saves a third of the time of a cold start.

This hooks into `JITCodeLibrary` and `Compiler`, which are private to numba, hence the upper bound of its version in
pyproject.toml.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba.core import codegen, compiler
from numba.core import types as numba_types

types: Any = numba_types
_Function = TypeVar("_Function", bound=Callable[..., Any])
_Library: Any = codegen.JITCodeLibrary
_Compiler: Any = compiler.Compiler


class _Part(_Library):  # type: ignore[misc] # numba has no types
    """The code of a part, linked with what it calls."""

    def _optimize_final_module(self) -> None:
        """Leave it to the entries."""

    def _finalize_final_module(self) -> None:
        """Make no machine code."""
        self._finalized = True


class _Loop(_Library):  # type: ignore[misc] # numba has no types
    """The code of an entry whose speed counts, optimised twice: numba's pass at every level inlines more than one."""

    def _optimize_final_module(self) -> None:
        super()._optimize_final_module()
        super()._optimize_final_module()


class PartCompiler(_Compiler):  # type: ignore[misc] # numba has no types
    """The pipeline of numba, which ends before machine code: ``njit(pipeline_class=PartCompiler)``."""

    def compile_extra(self, function: Any) -> Any:
        """Compile a part; what stands for its machine code is never called."""
        state = self.state
        state.flags.no_compile = True
        state.library = _Part(state.targetctx.codegen(), function.__qualname__)
        found = super().compile_extra(function)
        never = {}.update  # type: ignore[var-annotated] # numba wants a built-in, one of its own for each part
        state.targetctx.insert_user_function(never, found.fndesc, [found.library])
        return found._replace(entry_point=never)


class LoopCompiler(_Compiler):  # type: ignore[misc] # numba has no types
    """The pipeline of numba for the loop of the sampler's steps."""

    def compile_extra(self, function: Any) -> Any:
        """Compile an entry."""
        self.state.library = _Loop(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(function)


def share_integers(compiled: _Function) -> _Function:
    """Let kernels that call this one with integers of any width, or constants, share what is compiled for int64."""
    specialiser = getattr(compiled, "_compiler", None)
    if specialiser is not None:  # None with NUMBA_DISABLE_JIT
        fold = specialiser.fold_argument_types

        def widened(args: Any, keywords: Any) -> Any:
            signature, folded = fold(args, keywords)
            return signature, tuple(widest(each) for each in folded)

        specialiser.fold_argument_types = widened
    return compiled


def widest(kind: Any) -> Any:
    """Return the type of an argument with int64 for every signed integer in it, and no constants."""
    kind = types.unliteral(kind)
    if isinstance(kind, types.Integer) and kind.signed:
        return types.int64
    if type(kind) in (types.UniTuple, types.Tuple):
        return types.BaseTuple.from_types([widest(each) for each in kind])
    return kind
