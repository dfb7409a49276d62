"""Show the parameters of prior and sensors as a settings file, list presets, or check a file."""

from __future__ import annotations

from prf.shell.options import ConfigAction, ConfigFile, ConfigWhat, Json, Presets

EXAMPLES = (
    "prf config show > site.toml",
    "prf config show site.toml --preset hokuyo-utm-30lx",
    "prf config check site.toml",
    "prf config presets sick-lms200",
)


def config(
    action: ConfigWhat = ConfigAction.show,
    file: ConfigFile = None,
    preset: Presets = None,
    json: Json = False,
) -> None:
    """Show the parameters of prior and sensors as a settings file, list presets, or check a file.

    show prints a settings file with every parameter, its unit and its meaning: the defaults, or what FILE and presets
    make of them, and which of these said so. sample, anneal, grid and others take it by --config. check says all that
    is wrong with FILE, one problem a line, and ends with exit code 1 if there is any. presets lists the sensors whose
    parameters are known by name; presets NAME prints them, each with its source.
    """
    from prf.settings_file import SCHEMA
    from prf.shell.configuration.verb import check, needed_file, refuse_preset, show_presets

    if action is ConfigAction.show:
        _show(file, preset or [], json)
        return
    refuse_preset(action.value, preset)
    if action is ConfigAction.check:
        check(needed_file(file), SCHEMA, "prf.config.check/1" if json else None)
    else:
        show_presets(file, SCHEMA, "prf.config.presets/1" if json else None)


def _show(file: str | None, presets: list[str], json: bool) -> None:
    from prf.sampler.asked import ask, explain, settings_of
    from prf.sampler.config import SampleConfig
    from prf.settings_file import settings_text
    from prf.shell import console, jsonout

    asked = ask({}, file, presets=presets)
    settings = SampleConfig(**asked.values)
    if json:
        jsonout.emit_object("prf.config/1", {"settings": settings_of(settings), "set": sorted(asked.places.values())})
        return
    console.emit(settings_text(settings_of(settings), explain(settings, asked)).rstrip())
