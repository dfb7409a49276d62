"""Settings as files that people read: the text of a file, and what `prf config` and `mapq config` print."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from prf.shell.cli import console, storage
from prf.shell.cli.settings import (
    Loaded,
    T,
    Table,
    Tree,
    Values,
    load,
    note_of,
    preset_names,
    preset_text,
    read_preset,
    toml_of,
)


def show(
    tree: type[Tree],
    schema: str,
    file: str | None,
    presets: Sequence[str] | None,
    assignments: Sequence[str] | None,
    json: bool,
) -> None:
    """Print what a file, presets and assignments make of the settings, as a settings file or an object of `schema`."""
    loaded = load(tree, file, presets or (), assignments or ())
    if json:
        content = {"settings": values_of(loaded.settings), "set": sorted(loaded.sources.values())}
        storage.emit_object(schema, content)
    else:
        head = f"Settings of {tree.PACKAGE}, SI units. Keys that are left out have their defaults."
        console.emit(described_text(loaded, head).rstrip())


def show_presets(tree: type[Tree], schema: str, name: str | None, json: bool) -> None:
    """Print the file of one preset, or a line for each, or an object; ConfigError if there is none of this name."""
    chosen = {each: read_preset(tree, each, "config presets") for each in ([name] if name else preset_names(tree))}
    titles = {each: preset_text(tree, each).partition("\n")[0].removeprefix("# ") for each in chosen}
    if json:
        content = [{"name": each, "title": titles[each], "settings": values} for each, values in chosen.items()]
        storage.emit_object(schema, {"presets": content})
    elif name:
        console.emit(preset_text(tree, name).rstrip())
    else:
        width = max(map(len, chosen))
        for each in chosen:
            console.emit(f"{each:<{width}}  {titles[each]}")


def settings_text(values: Mapping[str, Mapping[str, Any]], comments: Mapping[str, str]) -> str:
    """Return the text of a settings file; its numbers are read back to the last bit.

    `comments`: for ``""`` (the head of the file), ``"TABLE"`` or ``"TABLE.KEY"``; the first two may have several lines.
    """
    parts = [_comment(comments.get("", ""))]
    for table, content in values.items():
        lines = {name: f"{name} = {toml_of(value)}" for name, value in content.items()}
        width = max(map(len, lines.values()), default=0)
        notes = {name: comments.get(f"{table}.{name}", "") for name in lines}
        rows = [f"{line:<{width}}  # {notes[name]}" if notes[name] else line for name, line in lines.items()]
        parts.append(_comment(comments.get(table, "")) + "\n".join([f"[{table}]", *rows]) + "\n")
    return "\n".join(part for part in parts if part)


def described_text(loaded: Loaded[T], head: str) -> str:
    """Return a settings file with every key: its meaning, and what has set it; keys without value as comments."""
    values: Values = {}
    comments = {"": head}
    for table, model in type(loaded.settings).tables().items():
        lines, values[table] = [(model.__doc__ or "").partition("\n")[0]], {}
        for name, field in model.model_fields.items():
            unit, place = note_of(model, name, "unit"), f"{table}.{name}"
            words = (f"[{unit}] " if unit else "") + (field.description or "")
            value = loaded.settings.get(place)
            if value is None:
                lines.append(f"{name}: {words}")
            else:
                values[table][name], comments[place] = value, words + _set_by(loaded.sources.get(place))
        comments[table] = "\n".join(lines)
    return settings_text(values, comments)


def _set_by(source: str | None) -> str:
    return "" if source is None else f" ({source.partition(':')[0] if source.startswith('preset ') else 'set here'})"


def _comment(text: str) -> str:
    return "".join(f"# {line}".rstrip() + "\n" for line in text.splitlines())


def values_of(settings: Tree) -> Values:
    """Return the values by table, without keys that are None."""
    return {table: dict(_set_in(getattr(settings, table))) for table in type(settings).tables()}


def _set_in(table: Table) -> Iterator[tuple[str, Any]]:
    return ((name, value) for name, value in table if value is not None)
