"""Show all settings as a settings file, or list presets."""

from __future__ import annotations

from prf.shell.cli.options import Assignments, ConfigAction, ConfigFile, ConfigWhat, Json, Presets

EXAMPLES = (
    "prf config show > site.toml",
    "prf config show site.toml --preset hokuyo-utm-30lx --set prior.scale=0.2",
    "prf config presets sick-lms200",
)


def config(
    action: ConfigWhat = ConfigAction.show,
    file: ConfigFile = None,
    preset: Presets = None,
    assignments: Assignments = None,
    json: Json = False,
) -> None:
    """Show all settings as a settings file, or list presets.

    show prints a settings file with every key, its unit and its meaning: the defaults, or what FILE, presets and --set
    make of them, and which of these has set a value; a FILE with a mistake is refused. sample, anneal, grid and others
    take it by --config. presets lists the sensors whose parameters are known by name; presets NAME prints them, each
    with its source.
    """
    from prf.configuration import Configuration
    from prf.shell.cli.settings_file import show, show_presets

    if action is ConfigAction.show:
        show(Configuration, "prf.config/1", file, preset, assignments, json)
    else:
        show_presets(Configuration, "prf.config.presets/1", file, json)
