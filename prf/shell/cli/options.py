"""Options that mean the same thing in every verb, declared once.

A verb writes ``force: Force = False`` and gets flag, help text and metavar from here. These are for verbs to declare:

========== ======================== =====================================================
type       flag                     meaning
========== ======================== =====================================================
Output     ``-o/--output``          where the result goes; ``-`` is standard output
Force      ``-f/--force``           overwrite an output that exists
Seed       ``--seed``               seed of every random number; drawn and printed if absent
Threads    ``--threads``            threads to use, 0 = one a core; never changes a result
Json       ``--json``               the result as one JSON object on standard output
Presets    ``--preset``             presets of sensors, beneath the settings file
Assignments ``--set``                any key of the settings, above the file
========== ======================== =====================================================

``-v/--verbose``, ``-q/--quiet``, ``--color`` and ``--no-progress`` are added to every verb (`app.py`), so
that no verb can forget one; a verb must not declare them.
"""

from __future__ import annotations

import re
from enum import StrEnum
from operator import mul
from typing import Annotated

import typer

Output = Annotated[
    str | None, typer.Option("--output", "-o", metavar="PATH", help="Where the result goes; - is standard output.")
]
Force = Annotated[bool, typer.Option("--force", "-f", help="Overwrite an output that exists.")]
Seed = Annotated[
    int | None,
    typer.Option("--seed", metavar="INT", min=0, help="Seed of every random number; drawn and printed if absent."),
]
Threads = Annotated[
    int, typer.Option("--threads", metavar="N", min=0, help="Threads, 0 = one a core; never changes a result.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")]
Presets = Annotated[
    list[str] | None,
    typer.Option("--preset", metavar="NAME", help="Preset of a sensor, repeatable; config presets lists them."),
]
Assignments = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Any key of the settings, repeatable; config lists them."),
]


SECONDS = {"h": 3600.0, "m": 60.0, "s": 1.0}
"""In each unit of a duration."""
DURATION = re.compile("(?=.)" + "".join(rf"(?:(\d+(?:\.\d+)?){unit})?" for unit in SECONDS))


def parse_duration(text: str) -> float:
    """Return the seconds in ``90``, ``90s``, ``1.5m``, ``2h`` or ``1h30m``; ValueError if it is none of these."""
    words = text.strip().lower()
    found = DURATION.fullmatch(words)
    try:
        seconds = sum(map(mul, map(float, found.groups("0")), SECONDS.values())) if found else float(words)
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds < float("inf"):
        raise ValueError(f"{text!r}: must be seconds, or minutes and hours as 5m, 1.5h or 1h30m")
    return seconds


class ConfigAction(StrEnum):
    """What `prf config` and `mapq config` do."""

    show = "show"
    presets = "presets"


ConfigWhat = Annotated[
    ConfigAction,
    typer.Argument(metavar="show|presets", help="Print all settings, or presets of sensors."),
]
ConfigFile = Annotated[
    str | None, typer.Argument(metavar="FILE|NAME", help="Settings file, TOML, - is standard input; or a preset.")
]
