"""The picture of a map that is being looked for: the best one so far, its score and the temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from prf.coloring import Coloring
from prf.render.live import FACTS, FEW, WIDE, beside, clock
from prf.render.terminal import covered
from prf.shell.terminal import Canvas, Screen, fitted, grey_raster, with_words

if TYPE_CHECKING:
    from rich.text import Text


class MapGlance(NamedTuple):
    """The best map at one moment.

    Attributes
    ----------
    name : str
    best : Coloring
    by_chain : tuple of float
        Best score of each chain, nats.
    temperature : float
    step : int
        Of each chain.
    seconds : float
    share : float
        Of the work that is done.
    """

    name: str
    best: Coloring
    by_chain: tuple[float, ...]
    temperature: float
    step: int
    seconds: float
    share: float


def live_map_lines(glance: MapGlance, screen: Screen) -> list[Text]:
    """Return picture and facts for a terminal, no more lines than it has; facts at the right where there is room."""
    rows = max(8, (screen.rows or 24) - 1)
    facts = _facts(glance, screen)
    if screen.columns < WIDE:
        picture = _picture(glance, screen, screen.columns, max(3, rows - FEW - 2))
        return [*picture, *fitted(facts[:FEW], screen)]
    picture = _picture(glance, screen, screen.columns - FACTS - 2, rows - 2)
    below = fitted(facts[:rows], screen._replace(columns=FACTS))
    return beside(picture, below, max(line.cell_len for line in picture))


def _picture(glance: MapGlance, screen: Screen, columns: int, rows: int) -> list[Text]:
    canvas = Canvas.fit(glance.best.window, columns, rows)
    raster = grey_raster(covered(glance.best, canvas), screen)
    return with_words(raster, canvas, screen._replace(columns=columns))


def _facts(glance: MapGlance, screen: Screen) -> list[Text]:
    """Return what there is to say, what counts most first."""
    from rich.text import Text

    rate = glance.step * len(glance.by_chain) / max(glance.seconds, 1e-9)
    lines = [
        Text(f"{glance.name}: best of {len(glance.by_chain)} chains, {glance.best.n_edges} edges", "bold"),
        Text(f"score {max(glance.by_chain):,.1f} nats, temperature {round(glance.temperature, 6):.2g}"),
        Text(f"step {glance.step:,}, {rate:,.0f} steps/s"),
        Text(clock(glance.share, glance.seconds, screen)),
    ]
    chains = sorted(glance.by_chain, reverse=True)
    return [*lines, Text(), *(Text(f"{score:>16,.1f}  nats, best of a chain", "dim") for score in chains)]
