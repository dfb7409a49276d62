"""How well a map predicts readings that it was not made from (docs/scores.md)."""

from prf.score.heldout import HeldOut, ScoreConfig, hold_out
from prf.score.maps import DrawsMap, GridMap, PolygonMap, ScoredMap, open_map
from prf.score.points import Points, classification_scores, draw_points, ranking_area
from prf.score.polygons import OccupiedArea, read_occupied_area
from prf.score.score import score

__all__ = [
    "DrawsMap",
    "GridMap",
    "HeldOut",
    "OccupiedArea",
    "Points",
    "PolygonMap",
    "ScoreConfig",
    "ScoredMap",
    "classification_scores",
    "draw_points",
    "hold_out",
    "open_map",
    "ranking_area",
    "read_occupied_area",
    "score",
]
