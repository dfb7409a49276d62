"""Parts of kernels that are optimised once, in the kernel that calls them.

Numba optimises every function with all that it calls, and makes machine code of the whole, again at each level of
calls, although of a part that Python never calls none of this is used. Here a part is only lowered; its code is linked
into the entries that call it, directly or not, and optimised there. That halves the time of a cold start.

This hooks into `JITCodeLibrary` and `Compiler`, which are private to numba, hence the upper bound of its version in
pyproject.toml. Where their names are missing, everything is compiled as numba does it: the same code, later.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba.core import types as numba_types

types: Any = numba_types
_Function = TypeVar("_Function", bound=Callable[..., Any])


def part_options() -> dict[str, Any]:
    """Return options of ``njit`` for functions that only other kernels call; none if this numba lacks the hooks."""
    try:
        from numba.core import codegen, compiler

        codegen.JITCodeLibrary._get_module_for_linking  # noqa: B018 - whether it is there
        return {"pipeline_class": _part_compiler(codegen.JITCodeLibrary, compiler.Compiler)}
    except (ImportError, AttributeError):
        return {}


def loop_options() -> dict[str, Any]:
    """Return options of ``njit`` for the entry whose speed counts: its parts are inlined and optimised twice.

    Numba's own way, a pass at every level, inlines more: a step takes 7 % longer after one pass here, 3 % after two.
    """
    try:
        from numba.core import codegen, compiler

        codegen.JITCodeLibrary._optimize_final_module  # noqa: B018 - whether it is there
        return {"pipeline_class": _loop_compiler(codegen.JITCodeLibrary, compiler.Compiler)}
    except (ImportError, AttributeError):
        return {}


def _loop_compiler(library: Any, compiler: Any) -> type:
    class Loop(library):  # type: ignore[misc] # numba has no types
        """The code of an entry."""

        def _optimize_final_module(self) -> None:
            super()._optimize_final_module()
            super()._optimize_final_module()

    class LoopCompiler(compiler):  # type: ignore[misc] # numba has no types
        """The pipeline of numba, with that library."""

        def compile_extra(self, function: Any) -> Any:
            """Compile an entry."""
            self.state.library = Loop(self.state.targetctx.codegen(), function.__qualname__)
            self.state.library.enable_object_caching()
            return super().compile_extra(function)

    return LoopCompiler


def _part_compiler(library: Any, compiler: Any) -> type:
    class Part(library):  # type: ignore[misc] # numba has no types
        """The code of a part, as lowered, and at the first call of :meth:`_get_module_for_linking` of all below."""

        _whole: Any = None

        def finalize(self) -> None:
            """Neither link nor optimise, nor make machine code."""
            self._raise_if_finalized()
            self._finalized = True

        def own_module(self) -> Any:
            """Return the code of this part alone; the linker drops copies of it, and what nobody calls."""
            for function in self._final_module.functions:
                if not function.is_declaration and function.linkage.name == "external":
                    function.linkage = "linkonce_odr"
            return self._final_module

        def after(self, order: dict[Any, None]) -> dict[Any, None]:
            """Enter all libraries below this one into `order`, each after those that it calls."""
            for below in self._linking_libraries:
                if below not in order:
                    if isinstance(below, Part):
                        below.after(order)
                    order[below] = None
            return order

        def _get_module_for_linking(self) -> Any:
            if self._whole is None:
                self._whole = self.own_module().clone()
                # Callers first: the linker takes a function only if something calls it already.
                for below in reversed(self.after({})):
                    if hasattr(self, "_reload_init"):  # not in numba 0.62
                        self._reload_init.update(below._reload_init)
                    code = below.own_module() if isinstance(below, Part) else below._get_module_for_linking()
                    self._whole.link_in(code, preserve=True)
            return self._whole

    class PartCompiler(compiler):  # type: ignore[misc] # numba has no types
        """The pipeline of numba, which ends before machine code."""

        def compile_extra(self, function: Any) -> Any:
            """Compile a part; what stands for its machine code is never called."""
            state = self.state
            state.flags.no_compile = True
            state.library = Part(state.targetctx.codegen(), function.__qualname__)
            found = super().compile_extra(function)
            never = {}.update  # type: ignore[var-annotated] # numba wants a built-in, one of its own for each part
            state.targetctx.insert_user_function(never, found.fndesc, [found.library])
            return found._replace(entry_point=never)

    return PartCompiler


def share_integers(compiled: _Function) -> _Function:
    """Let kernels that call this one with integers of any width, or constants, share what is compiled for int64."""
    compiler = getattr(compiled, "_compiler", None)
    if compiler is not None and hasattr(compiler, "fold_argument_types"):
        fold = compiler.fold_argument_types

        def widened(args: Any, keywords: Any) -> Any:
            signature, folded = fold(args, keywords)
            return signature, tuple(widest(each) for each in folded)

        compiler.fold_argument_types = widened
    return compiled


def widest(kind: Any) -> Any:
    """Return the type of an argument with int64 for every signed integer in it, and no constants."""
    kind = types.unliteral(kind)
    if isinstance(kind, types.Integer) and kind.signed:
        return types.int64
    if type(kind) in (types.UniTuple, types.Tuple):
        return types.BaseTuple.from_types([widest(each) for each in kind])
    return kind
