"""What `prf config` and `mapq config` do alike: check a settings file, list and print presets."""

from __future__ import annotations

from collections.abc import Sequence

from prf.shell import console, jsonout
from prf.shell.configuration.file import problems_of
from prf.shell.configuration.presets import preset_names, read_preset
from prf.shell.configuration.schema import Schema
from prf.shell.errors import CheckFailed, UsageError


def needed_file(file: str | None) -> str:
    """Return the FILE of ``config check``; raise UsageError if there is none."""
    if file is None:
        raise UsageError("config check needs a FILE.")
    return file


def refuse_preset(action: str, presets: Sequence[str] | None) -> None:
    """Raise UsageError if ``--preset`` is given to an action that takes none."""
    if presets:
        raise UsageError(f"--preset goes with config show; config {action} takes a name or a file as it is.")


def check(file: str, schema: Schema, json: str | None) -> None:
    """Print all that is wrong with a settings file; as an object of the schema `json`, if one is named.

    Raises
    ------
    CheckFailed
        If something is.
    InputError
        If the file cannot be read.
    """
    problems = problems_of(file, schema)
    if json is not None:
        jsonout.emit_object(json, {"path": file, "problems": problems})
    else:
        console.emit("\n".join(problems) or f"{file}: sound")
    if problems:
        raise CheckFailed(f"{file}: {len(problems)} {'problem' if len(problems) == 1 else 'problems'}.")


def show_presets(name: str | None, schema: Schema, json: str | None) -> None:
    """Print the file of one preset, or a line for each; or an object of the schema `json`, if one is named.

    Raises
    ------
    ConfigError
        If there is no preset of this name.
    """
    chosen = [read_preset(each, schema, "config presets") for each in ([name] if name else preset_names(schema))]
    if json is not None:
        content = [{"name": each.name, "title": each.title, "settings": each.tables} for each in chosen]
        jsonout.emit_object(json, {"presets": content})
    elif name:
        console.emit(chosen[0].text.rstrip())
    else:
        width = max(len(each.name) for each in chosen)
        for each in chosen:
            console.emit(f"{each.name:<{width}}  {each.title}")
