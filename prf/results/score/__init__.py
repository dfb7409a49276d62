"""How well a map predicts readings that it was not made from (docs/scores.md)."""

from prf.results.geojson import OccupiedArea, read_occupied_area
from prf.results.score.heldout import HeldOut, HeldOutSonar, hold_out, hold_out_sonar
from prf.results.score.maps import DrawsMap, GridMap, PolygonMap, ScoredMap, open_map, poses_of_run
from prf.results.score.score import (
    LabelledPoints,
    classification_scores,
    draw_points,
    ranking_area,
    score,
    true_cells,
)

__all__ = [
    "DrawsMap",
    "GridMap",
    "HeldOut",
    "HeldOutSonar",
    "LabelledPoints",
    "OccupiedArea",
    "PolygonMap",
    "ScoredMap",
    "classification_scores",
    "draw_points",
    "hold_out",
    "hold_out_sonar",
    "open_map",
    "poses_of_run",
    "ranking_area",
    "read_occupied_area",
    "score",
    "true_cells",
]
