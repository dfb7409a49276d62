"""The RUN directory: what a run of the sampler leaves, each file versioned (docs/file-formats.md)."""

from prf.run.mapfile import map_text, read_map_feature
from prf.run.model import Beams, Cones, Points, PosteriorImage, Run
from prf.run.points import read_points
from prf.run.read import is_run, read_manifest, read_run
from prf.run.state import FileState, inspect_files
from prf.run.write import write_manifest, write_run

__all__ = [
    "Beams",
    "Cones",
    "FileState",
    "Points",
    "PosteriorImage",
    "Run",
    "inspect_files",
    "is_run",
    "map_text",
    "read_manifest",
    "read_map_feature",
    "read_points",
    "read_run",
    "write_manifest",
    "write_run",
]
