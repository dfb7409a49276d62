"""Show the parameters of prior and sensors as a settings file, or check such a file."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from prf.shell.options import Json

EXAMPLES = (
    "prf config show > site.toml",
    "prf config show site.toml",
    "prf config check site.toml",
)


class Action(StrEnum):
    """What to do."""

    show = "show"
    check = "check"


def config(
    action: Annotated[
        Action, typer.Argument(metavar="show|check", help="Print all parameters, or what is wrong with a file.")
    ] = Action.show,
    file: Annotated[
        str | None, typer.Argument(metavar="FILE", help="Settings file, TOML; - is standard input.")
    ] = None,
    json: Json = False,
) -> None:
    """Show the parameters of prior and sensors as a settings file, or check such a file.

    show prints a settings file with every parameter, its unit and its meaning: the defaults, or what FILE makes of
    them. sample, anneal, grid and others take it by --config. check says all that is wrong with FILE, one problem a
    line, and ends with exit code 1 if there is any.
    """
    from prf.shell.errors import UsageError

    if action is Action.show:
        _show(file, json)
    elif file is None:
        raise UsageError("config check needs a FILE.")
    else:
        _check(file, json)


def _show(file: str | None, json: bool) -> None:
    from prf.sampler.asked import ask, explain, settings_of
    from prf.sampler.config import SampleConfig
    from prf.settings_file import settings_text
    from prf.shell import console, jsonout

    asked = ask({}, file)
    settings = SampleConfig(**asked.values)
    if json:
        jsonout.emit_object("prf.config/1", {"settings": settings_of(settings), "set": sorted(asked.places.values())})
        return
    console.emit(settings_text(settings_of(settings), explain(settings, asked)).rstrip())


def _check(file: str, json: bool) -> None:
    from prf.settings_file import check_settings
    from prf.shell import console, jsonout
    from prf.shell.errors import CheckFailed

    problems = check_settings(file)
    if json:
        jsonout.emit_object("prf.config.check/1", {"path": file, "problems": problems})
    else:
        console.emit("\n".join(problems) or f"{file}: sound")
    if problems:
        raise CheckFailed(f"{file}: {len(problems)} {'problem' if len(problems) == 1 else 'problems'}.")
