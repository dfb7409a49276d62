"""The picture of a run while it is sampled: posterior and best map so far, speed, agreement, acceptance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import timedelta
from typing import TYPE_CHECKING, NamedTuple

from prf.coloring import Coloring
from prf.diagnostics import Diagnosis
from prf.render.terminal import outline_layer
from prf.run import PosteriorImage
from prf.shell.terminal import Canvas, Screen, fitted, grey_raster, with_words
from prf.window import Window

if TYPE_CHECKING:
    from rich.text import Text

FACTS = 44
"""Columns of the facts beside a picture."""
WIDE = 96
"""Columns from which on facts stand beside the picture, not below it."""
FEW = 5
"""Lines of facts below a picture."""
BAR = 12
AGREES, DIFFERS = "green", "yellow"


class Glance(NamedTuple):
    """A run at one moment.

    Attributes
    ----------
    name : str
    window : Window
    image : PosteriorImage
        Posterior after burn-in, so far.
    best : Coloring or None
        Best map so far.
    step : int
        Of each chain.
    chains, rungs : int
        Rungs of tempering a chain, 1 for none.
    seconds, steps_per_second : float
    share : float
        Of the goal.
    is_limit : bool
        Whether the goal is agreement, and `share` that of the time after which it is given up.
    diagnoses : mapping of str to Diagnosis
        Of the latest check.
    accepted : sequence of (str, int, int)
        Of each kind of move: its name, proposals, and how many were accepted.
    """

    name: str
    window: Window
    image: PosteriorImage
    best: Coloring | None
    step: int
    chains: int
    rungs: int
    seconds: float
    steps_per_second: float
    share: float
    is_limit: bool
    diagnoses: Mapping[str, Diagnosis]
    accepted: Sequence[tuple[str, int, int]]


def live_lines(glance: Glance, screen: Screen) -> list[Text]:
    """Return picture and facts for a terminal, no more lines than it has; facts at the right where there is room."""
    rows = max(8, (screen.rows or 24) - 1)
    if screen.columns < WIDE:
        picture = _picture(glance, screen, screen.columns, max(3, rows - FEW - 2))
        return [*picture, *fitted(_few_facts(glance, screen), screen)]
    picture = _picture(glance, screen, screen.columns - FACTS - 2, rows - 2)
    facts = fitted(_all_facts(glance, screen, rows), screen._replace(columns=FACTS))
    return beside(picture, facts, max(line.cell_len for line in picture))


def _picture(glance: Glance, screen: Screen, columns: int, rows: int) -> list[Text]:
    canvas = Canvas.fit(glance.window, columns, rows)
    means = canvas.means(glance.image.occupancy, glance.image.origin, glance.image.resolution)
    layers = (
        ()
        if glance.best is None or screen.colours is None or not screen.braille
        else (outline_layer(glance.best, canvas),)
    )
    raster = grey_raster(means, screen, layers)
    return with_words(raster, canvas, screen._replace(columns=columns))


def beside(picture: list[Text], facts: list[Text], width: int) -> list[Text]:
    """Return facts at the right of a picture."""
    from rich.text import Text

    lines = []
    for number in range(max(len(picture), len(facts))):
        line = picture[number] if number < len(picture) else Text()
        line.append(" " * (width + 2 - line.cell_len))
        lines.append(line.append_text(facts[number]) if number < len(facts) else line)
    return lines


def _few_facts(glance: Glance, screen: Screen) -> list[Text]:
    """Return the facts that count most."""
    from rich.text import Text

    lines = [_headline(glance), Text(_speed(glance)), Text(_clock(glance, screen))]
    worst = _worst(glance.diagnoses)
    if worst is not None:
        name, found = worst
        lines.append(Text(f"{name}: R-hat {_number(found.rhat, 3)}, ESS {_number(found.ess, 0)}", _colour(found)))
    return [*lines, Text(_acceptance(glance))][:FEW]


def _all_facts(glance: Glance, screen: Screen, rows: int) -> list[Text]:
    """Return the facts with a line a functional, and as many moves as there is room for."""
    from rich.text import Text

    lines = [_headline(glance), Text(_speed(glance)), Text(_clock(glance, screen)), Text()]
    lines += _agreement(glance.diagnoses)
    lines += [Text(words, AGREES if not places else DIFFERS) for words, places in _where(glance.image)]
    lines += [Text(), Text(_acceptance(glance))]
    moves = [f"{_percent(n, of):>8}  {name}" for name, of, n in glance.accepted if of]
    return [*lines, *(Text(move, "dim") for move in moves)][:rows]


def _headline(glance: Glance) -> Text:
    from rich.text import Text

    rungs = f" of {glance.rungs} rungs" if glance.rungs > 1 else ""
    edges = "" if glance.best is None else f", best map {glance.best.n_edges} edges"
    return Text(f"{glance.name}: {glance.chains} chains{rungs}{edges}", "bold")


def _speed(glance: Glance) -> str:
    return f"step {glance.step:,}, {glance.steps_per_second:,.0f} steps/s"


def clock(share: float, seconds: float, screen: Screen) -> str:
    """Return a bar of the share that is done, the seconds that went by, and what is left."""
    full, empty = ("█", "░") if screen.blocks else ("#", ".")
    done = round(BAR * share)
    left = f", {_time(seconds * (1.0 - share) / share)} left" if share > 0.0 else ""
    return f"{full * done}{empty * (BAR - done)} {_time(seconds)}{left}"


def _clock(glance: Glance, screen: Screen) -> str:
    return clock(glance.share, glance.seconds, screen) + (" at most" if glance.is_limit and glance.share else "")


def _agreement(diagnoses: Mapping[str, Diagnosis]) -> list[Text]:
    """Return R-hat and ESS of every functional, and of the worst of the points whose colour is followed."""
    from rich.text import Text

    if not diagnoses:
        return [Text("agreement of the chains: not checked yet")]
    points = {name: found for name, found in diagnoses.items() if name.startswith("colour at ")}
    rows = [(name, found) for name, found in diagnoses.items() if name not in points]
    for seen, kind in ((True, "points"), (False, "unseen points")):
        chosen = {name: found for name, found in points.items() if found.seen == seen}
        worst = _worst(chosen)
        if worst is not None:
            rows.append((f"worst of {len(chosen)} {kind}", worst[1]))
    lines = [Text(f"{'':<24}{'R-hat':>8}{'ESS':>8}", "dim")]
    for name, found in rows:
        row = f"{name.replace('_', ' '):<24}{_number(found.rhat, 3):>8}{_number(found.ess, 0):>8}"
        lines.append(Text(row, _colour(found)))
    return lines


def _where(image: PosteriorImage) -> list[tuple[str, bool]]:
    """Return lines about the ground on which chains agree, and whether each is of places where they do not."""
    where = image.agreement()
    if where is None or math.isnan(where.seen):
        return []
    lines = [(f"agree on {math.floor(100.0 * where.seen)} % of the seen ground", bool(where.places))]
    return lines + [(f"differ round ({place.x:.1f}, {place.y:.1f})", True) for place in where.places[:1]]


def _worst(diagnoses: Mapping[str, Diagnosis]) -> tuple[str, Diagnosis] | None:
    """Return what is furthest from agreeing: the largest R-hat, of those that differ at all."""
    found = [(name, each) for name, each in diagnoses.items() if each.state != "constant"]
    return max(found, key=lambda pair: math.inf if math.isnan(pair[1].rhat) else pair[1].rhat, default=None)


def _colour(found: Diagnosis) -> str:
    return AGREES if found.agrees() else DIFFERS


def _acceptance(glance: Glance) -> str:
    proposed = sum(of for _, of, _ in glance.accepted)
    return f"accepted {_percent(sum(n for _, _, n in glance.accepted), proposed)} of {proposed:,} proposals"


def _percent(number: int, of: int) -> str:
    return f"{100.0 * number / max(of, 1):.1f} %"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _time(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
