"""The RUN directory: what a run of the sampler leaves, each file versioned (docs/file-formats.md)."""

from prf.results.geojson import map_text, read_map_feature
from prf.results.read import is_run, read_manifest, read_run_data
from prf.results.run import PosteriorImage, Progress, RunData, Status
from prf.results.write import write_manifest, write_run

__all__ = [
    "PosteriorImage",
    "Progress",
    "RunData",
    "Status",
    "is_run",
    "map_text",
    "read_manifest",
    "read_map_feature",
    "read_run_data",
    "write_manifest",
    "write_run",
]
