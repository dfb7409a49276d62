"""Writes docs/reference/cli-prf.md and cli-mapq.md from the command lines themselves: `python -m docs.make_reference`.

Everything stands in the tools: summaries, help texts, options with their defaults, examples, exit codes. A test fails
where a page is not what this program writes.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import mapq.cli
import prf.cli
from prf.shell.cli.app import EXIT_CODES, LazyGroup, common_flags

TOOLS = {"prf": prf.cli, "mapq": mapq.cli}
FOLDER = Path(__file__).parent / "reference"

HEAD = """# Every verb and flag of `{tool}`

<!-- Written by `make docs` from the command line itself: edit help texts and examples there. -->

{summary}

A default in words is what the program works out; – is none. Without `-o` a result is named after its input, or as
the text of the verb says. An option can also be set by an environment variable: `--seed` of a verb by
`{prefix}_VERB_SEED`; a flag takes precedence. Results go to standard output, all else to standard error.

{verbs}

## Flags of every verb

{common}

## Exit codes

{codes}
"""
BRACKET = re.compile(r"\s{2}\[([^\[\]]*)\]$")
LIMITS = re.compile(r"^(?:(\S+)<=)?x(?:<=(\S+)|>=(\S+))?$")
TYPE = re.compile(r" <(?:str|list\[str\])>$")


class Row(NamedTuple):
    """An option or argument: how it is written, its default, what it means; Markdown."""

    written: str
    default: str
    meaning: str


def read_row(parameter: Any, context: Any) -> Row:
    """Return what the help text of a verb says of one of its parameters."""
    written, text = parameter.get_help_record(context)
    default, limits = "off" if getattr(parameter, "is_flag", False) else "–", ""
    while match := BRACKET.search(text):
        text = text[: match.start()]
        for part in match[1].split("; "):
            if found := LIMITS.match(part):
                limits = _limits(found[1] or found[3], found[2])
            else:
                default = part.removeprefix("default: ")
    return Row(f"`{TYPE.sub('', written)}`", default, text.strip() + limits)


def _limits(low: str | None, high: str | None) -> str:
    words = f"{low} to {high}" if low and high else f"{low} at least" if low else f"{high} at most"
    return f" ({words})"


def _table(rows: list[Row], first: str) -> str:
    lines = [f"| {first} | default | meaning |", "|---|---|---|"]
    cells = ([cell.replace("|", "\\|") for cell in row] for row in rows)
    return "\n".join(lines + [f"| {' | '.join(row)} |" for row in cells])


def rows_of(command: Any) -> tuple[list[Row], list[Row], list[Row]]:
    """Return what a verb takes: arguments, options of its own, and flags that every verb has."""
    context = command.context_class(command, **command.context_settings)
    shared = {option for flag in common_flags() for option in flag.opts} | {"--help"}
    arguments, options, common = [], [], []
    for parameter in command.get_params(context):
        is_option = parameter.param_type_name == "option"
        where = common if shared & set(parameter.opts) else options if is_option else arguments
        where.append(read_row(parameter, context))
    return arguments, options, common


def verb_section(tool: str, app: LazyGroup, verb: str) -> str:
    """Return the section of one verb: help text, usage, parameters, examples."""
    command = app.get_command(None, verb)
    arguments, options, _ = rows_of(command)
    examples = sys.modules[f"{app.package}.{verb.replace('-', '_')}"].EXAMPLES
    parts = [
        f"## {tool} {verb}",
        command.help,
        "\n".join(f"    {line}" for line in examples),
        _table(arguments, "argument") if arguments else "",
        _table(options, "option") if options else "",
    ]
    return "\n\n".join(part for part in parts if part)


def make_page(tool: str, module: ModuleType) -> str:
    """Return the page of one tool."""
    app = module.app
    head = HEAD.format(
        tool=tool,
        prefix=tool.upper(),
        summary=" ".join(module.HELP.split()),
        verbs="\n".join(f"- [`{tool} {verb}`](#{tool}-{verb}): {text}" for verb, text in module.VERBS.items()),
        common=_table(rows_of(app.get_command(None, next(iter(module.VERBS))))[2], "option"),
        codes=_exit_codes(),
    )
    return "\n\n".join([head.rstrip(), *(verb_section(tool, app, verb) for verb in module.VERBS)]) + "\n"


def _exit_codes() -> str:
    rows = (line.split(None, 1) for line in EXIT_CODES.splitlines()[1:])
    return "\n".join(["| code | meaning |", "|---|---|", *(f"| {code} | {text} |" for code, text in rows)])


def main() -> None:
    """Write both pages."""
    FOLDER.mkdir(exist_ok=True)
    for tool, module in TOOLS.items():
        (FOLDER / f"cli-{tool}.md").write_text(make_page(tool, module))


if __name__ == "__main__":
    main()
