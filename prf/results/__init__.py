"""The RUN directory: what a run of the sampler leaves, each file versioned (docs/file-formats.md)."""

from prf.results.mapfile import map_text, read_map_feature
from prf.results.model import PosteriorImage, Progress, Status
from prf.results.points import read_points
from prf.results.read import is_run, read_manifest, read_run
from prf.results.run import PointEstimates, Run
from prf.results.write import write_manifest, write_run

__all__ = [
    "PointEstimates",
    "PosteriorImage",
    "Progress",
    "Run",
    "Status",
    "is_run",
    "map_text",
    "read_manifest",
    "read_map_feature",
    "read_points",
    "read_run",
    "write_manifest",
    "write_run",
]
