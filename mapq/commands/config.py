"""Show all settings as a settings file, or list presets."""

from __future__ import annotations

from prf.shell.cli.options import Assignments, ConfigAction, ConfigFile, ConfigWhat, Json, Presets

EXAMPLES = (
    "mapq config show > site.toml",
    "mapq config show site.toml --preset ouster-os1-64 --set segment.min_points=100",
    "mapq config presets velodyne-vlp16",
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
    make of them, and which of these has set a value. segment, features, train, classify, simulate and perturb take the
    file by --config. presets lists the sensors whose parameters are known by name; presets NAME prints them, each with
    its source.
    """
    from mapq.configuration import Configuration
    from prf.shell.cli.settings_file import show, show_presets

    if action is ConfigAction.show:
        show(Configuration, "mapq.config/1", file, preset, assignments, json)
    else:
        show_presets(Configuration, "mapq.config.presets/1", file, json)
