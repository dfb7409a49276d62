"""Show the parameters of the steps as a settings file, list presets, or check a file."""

from __future__ import annotations

from prf.shell.options import ConfigAction, ConfigFile, ConfigWhat, Json, Presets

EXAMPLES = (
    "mapq config show > site.toml",
    "mapq config show site.toml --preset ouster-os1-64",
    "mapq config check site.toml",
    "mapq config presets velodyne-vlp16",
)


def config(
    action: ConfigWhat = ConfigAction.show,
    file: ConfigFile = None,
    preset: Presets = None,
    json: Json = False,
) -> None:
    """Show the parameters of the steps as a settings file, list presets, or check a file.

    show prints a settings file with every parameter of segmentation, features and random field, its unit and its
    meaning: the defaults, or what FILE and presets make of them, and which of these said so. segment, features, train
    and classify take it by --config. check says all that is wrong with FILE, one problem a line, and ends with exit
    code 1 if there is any. presets lists the sensors whose parameters are known by name; presets NAME prints them,
    each with its source.
    """
    from mapq.settings import SCHEMA
    from prf.shell.configuration.verb import check, needed_file, refuse_preset, show_presets

    if action is ConfigAction.show:
        _show(file, preset, json)
        return
    refuse_preset(action.value, preset)
    if action is ConfigAction.check:
        check(needed_file(file), SCHEMA, "mapq.config.check/1" if json else None)
    else:
        show_presets(file, SCHEMA, "mapq.config.presets/1" if json else None)


def _show(file: str | None, presets: list[str] | None, json: bool) -> None:
    from mapq.settings import described, settings_from
    from prf.shell import console, jsonout
    from prf.shell.configuration import settings_text

    found = settings_from(file, presets)
    tables, comments = described(found)
    if json:
        places = sorted(place for said in found.places.values() for place in said.values())
        jsonout.emit_object("mapq.config/1", {"settings": tables, "set": places})
        return
    console.emit(settings_text(tables, comments).rstrip())
