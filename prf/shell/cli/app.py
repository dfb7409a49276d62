"""A tool's command: verbs imported only when they are called, and the flags and exit codes that all of them share."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from prf.shell.cli import console
from prf.shell.cli.console import ColorChoice
from prf.shell.errors import EXIT_OK

EXIT_CODES = """Exit codes:
  0    done
  1    the check failed
  2    usage or configuration error
  3    bad or missing input
  4    output exists or cannot be written
  70   internal error (rerun with -vv for the traceback)
  130  interrupted (143 by SIGTERM), after a checkpoint where the verb keeps one"""

SAME = {"info": "inspect"}
"""Verbs of one tool to what the other calls the same."""

_CONTEXT: dict[str, Any] = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


class LazyGroup(TyperGroup):
    """Lists its verbs from a table and imports only the one that is called."""

    package: str  # verb ``ros-map`` is function ``ros_map`` of module ``<package>.ros_map``
    verbs: Mapping[str, str]  # verb to the one-line summary that ``--help`` lists
    version: str  # what ``--version`` prints

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the verbs in the order of the table."""
        return list(self.verbs)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import and return the command of a verb, None if there is no such verb."""
        if cmd_name not in self.verbs:
            return None
        function_name = cmd_name.replace("-", "_")
        module = importlib.import_module(f"{self.package}.{function_name}")
        command = make_command(getattr(module, function_name), module.EXAMPLES)
        _name_variables(command, f"{self.name}_{cmd_name}")
        return command

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the verb that is called; that of the other tool for the same is named, as misspelt ones are."""
        meant = SAME.get(args[0], "")
        if args[0] not in self.verbs and meant in self.verbs:
            ctx.fail(f"No such command {args[0]!r}. Did you mean {meant!r}?")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the table of verbs without importing any."""
        if self.verbs:
            with formatter.section("Commands"):
                formatter.write_dl(list(self.verbs.items()))


class Verb(TyperCommand):
    """A verb, some of whose flags take a word in place of several numbers."""

    words: Mapping[str, str]  # these flags, and ``TABLE.KEY`` of the settings that each sets

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse arguments, ``--flag word`` as the assignment that it stands for."""
        for at, arg in enumerate(args[:-1]):
            if arg in self.words and args[at + 1].isalpha():
                args[at : at + 2] = ["--set", f"{self.words[arg]}={args[at + 1]}"]
        return super().parse_args(ctx, args)


def make_app(name: str, version: str, help_text: str, package: str, verbs: Mapping[str, str]) -> LazyGroup:
    """Return the command of a tool (see :class:`LazyGroup` for the parameters)."""
    context = {**_CONTEXT, "auto_envvar_prefix": name.upper()}
    app = typer.Typer(
        name=name, cls=LazyGroup, rich_markup_mode=None, pretty_exceptions_enable=False, context_settings=context
    )
    epilog = f"{_environment_rule(name)}\n\n{_verbatim(EXIT_CODES)}"
    app.callback(invoke_without_command=True, help=help_text, epilog=epilog)(_root)
    group = typer.main.get_command(app)
    assert isinstance(group, LazyGroup)
    group.package, group.verbs, group.version = package, verbs, version
    group.commands.update(dict.fromkeys(verbs))  # type: ignore[arg-type] # names are all that "did you mean" reads
    _add_common_flags(group)
    return group


def make_command(function: Callable[..., None], examples: Sequence[str]) -> Any:
    """Return the command of one verb: the options of `function`, the flags of every verb, examples and exit codes."""
    lines = _verbatim("\n".join(["Examples:", *(f"  {line}" for line in examples)]))
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(cls=Verb, epilog=f"{lines}\n\n{_verbatim(EXIT_CODES)}", context_settings=_CONTEXT)(function)
    command = typer.main.get_command(app)
    assert isinstance(command, Verb)
    command.words = getattr(function, "words", {})
    _add_common_flags(command)
    return command


def _add_common_flags(command: Any) -> None:
    """Append the flags of every verb; the name of each option's variable follows a rule and is not listed."""
    command.params.extend(common_flags())
    for param in command.params:
        param.show_envvar = False


def _name_variables(command: Any, prefix: str) -> None:
    """Name the environment's variable of each option by its flag: by itself it has the name of the parameter."""
    for param in command.params:
        flag = next((flag for flag in param.opts if flag.startswith("--")), None)
        if flag is not None:
            param.envvar = f"{prefix}_{flag.removeprefix('--')}".replace("-", "_").upper()


def _set_verbose(count: int) -> None:
    console.settings.verbosity += count
    console.configure()


def _set_quiet(quiet: bool) -> None:
    console.settings.verbosity -= int(quiet)
    console.configure()


def _set_color(choice: ColorChoice | None) -> None:
    console.settings.color = choice or console.settings.color


def _set_no_progress(no_progress: bool) -> None:
    console.settings.progress = console.settings.progress and not no_progress


_Verbose = Annotated[
    int,
    typer.Option(
        *("--verbose", "-v"),
        count=True,
        callback=_set_verbose,
        expose_value=False,
        show_default=False,
        help="Show more on standard error; -vv also shows tracebacks.",
    ),
]
_Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        callback=_set_quiet,
        expose_value=False,
        help="Show errors only, no summary of a result that is written to a file.",
    ),
]
_Color = Annotated[
    ColorChoice | None,
    typer.Option(
        "--color",
        callback=_set_color,
        expose_value=False,
        metavar="auto|always|never",
        help="Colour on standard error; NO_COLOR and FORCE_COLOR count too.",
    ),
]
_NoProgress = Annotated[
    bool, typer.Option("--no-progress", callback=_set_no_progress, expose_value=False, help="Show no progress.")
]


def _signature(
    verbose: _Verbose = 0, quiet: _Quiet = False, color: _Color = None, no_progress: _NoProgress = False
) -> None:
    """Carry the flags of every verb, whose callbacks fill `console.settings`; never called."""


def common_flags() -> list[Any]:
    """Return the parameters ``-v``, ``-q``, ``--color`` and ``--no-progress`` for a command to append to its own."""
    carrier = typer.Typer(add_completion=False, rich_markup_mode=None)
    carrier.command()(_signature)
    return list(typer.main.get_command(carrier).params)


def _environment_rule(name: str) -> str:
    variable = f"{name.upper()}_VERB_MAX_RANGE"
    return f"An option --max-range of a verb can be set as {variable} in the environment; a flag takes precedence."


def _print_version(ctx: typer.Context, wanted: bool) -> None:
    if wanted:
        group: Any = ctx.command
        typer.echo(f"{ctx.info_name} {group.version}")
        raise typer.Exit(EXIT_OK)


def _root(
    ctx: typer.Context,
    _version: Annotated[
        bool, typer.Option("--version", "-V", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Answer a call without a verb with the help text, as a usage error."""
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help(), err=True)
        raise typer.Exit(2)


def _verbatim(lines: str) -> str:
    """Return a help paragraph with the formatter's mark against rewrapping."""
    return f"\b\n{lines}"
