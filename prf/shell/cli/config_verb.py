"""What `prf config` and `mapq config` do alike."""

from __future__ import annotations

from collections.abc import Sequence

from prf.shell.cli import console, storage
from prf.shell.cli.settings import Tree, described_text, load, preset_names, preset_text, read_preset, values_of


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
