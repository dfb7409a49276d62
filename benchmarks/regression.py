"""The rival that a statistician would try first: a logistic regression on counts of beams near a place (scikit-learn).

Features of a place are the numbers of beams of a log that end, and that pass, in squares of several sizes round it. The
regression is trained on the log itself, points of a fifth of its scans with the counts of the others, and predicts the
same points as `prf score`. It is fitted twice: with the weights of points for the scores that have them, and without.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prf.configuration import Configuration
from prf.kernels.state.grid import Grid, cells_of, make_grid
from prf.model.window import Window
from prf.readings import Readings, read_readings, thin
from prf.readings.ground import chosen_window, count_beams
from prf.results.score.heldout import HeldOut, hold_out
from prf.results.score.score import LabelledPoints, classification_scores, draw_points
from prf.shell.cli.storage import spawn_generators

CELL = 0.1
"""Side of the cells, metres."""
WIDTHS = (1, 3, 5, 9, 17)
"""Cells along the squares in which beams are counted."""
FOLDS = 5
MOST_POINTS = 200_000
"""Of each fold, chosen at random."""

Floats = NDArray[np.float64]


class Counts(NamedTuple):
    """Beams that end and that pass, in squares of each width round every cell."""

    grid: Grid
    layers: Floats  # (2 * len(WIDTHS), n_cells)

    def features(self, xy: Floats) -> Floats:
        """Return what is known of places (n, 2): log counts, and the log odds of ending, by width."""
        hits, passes = np.split(self.layers[:, cells_of(self.grid, xy)], 2)
        odds = np.log((hits + 0.5) / (passes - hits + 0.5))
        return np.concatenate([np.log1p(hits), np.log1p(passes), odds]).T


def counted(readings: Readings, window: Window) -> Counts:
    """Return the counts of the beams of a log."""
    grid = make_grid(*window, CELL)
    kept = readings.select(window.contains(readings.origin, strictly=True))
    passes, hits, _ = count_beams(grid, window, kept.origin, kept.angle, kept.range, kept.max_range)
    images = [layer.reshape(grid.ny, grid.nx).astype(np.float64) for layer in (hits, passes)]
    sums = [ndimage.uniform_filter(image, width, mode="constant") * width**2 for image in images for width in WIDTHS]
    return Counts(grid, np.maximum(np.round(np.reshape(sums, (len(sums), -1))), 0.0))


def labelled(beams: HeldOut, window: Window, rng: np.random.Generator) -> LabelledPoints:
    """Return points of known state along beams whose sensors are inside the window."""
    return draw_points(beams.select(window.contains(beams.origin, strictly=True)), rng)


def regression_scores(
    log: Path, held_out: str, max_range: float | None, seed: int, chosen: dict[str, Any]
) -> dict[str, float]:
    """Return the scores of the regression on the scans `held_out`, trained on the scans `chosen`."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    whole, config = read_readings(str(log)), Configuration().replace(max_range=max_range)
    kept = thin(whole, **chosen)
    kept = kept.within(hold_out(kept, config).model.limit)
    window = chosen_window(None, [kept])
    rng = np.random.default_rng(seed)
    rows, number = [], np.unique(kept.scan, return_inverse=True)[1]
    for fold in range(FOLDS):
        of_fold = number % FOLDS == fold
        points = labelled(hold_out(kept.select(of_fold), config), window, rng)
        some = rng.permutation(len(points.occupied))[:MOST_POINTS]
        assert points.weight is not None
        others = counted(kept.select(~of_fold), window).features(points.xy[some])
        rows.append((others, points.occupied[some], points.weight[some]))
    features, occupied, weight = (np.concatenate(column) for column in zip(*rows, strict=True))
    beams = hold_out(whole, config.replace(scans=held_out))
    points = labelled(beams, window, spawn_generators(seed, 1)[0])
    places = counted(kept, window).features(points.xy)
    found: dict[str, float] = {}
    for name, weights, scored_with in (("", weight, points.weight), ("_unweighted", None, None)):
        model = make_pipeline(StandardScaler(), LogisticRegression(max_iter=300))
        model.fit(features, occupied, logisticregression__sample_weight=weights)
        scores = classification_scores(model.predict_proba(places)[:, 1], points.occupied, scored_with)
        found |= {f"{score}{name}": value for score, value in scores.items()}
    return found
