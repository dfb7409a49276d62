"""Make the small map that `make demo` assesses: ``python data/make_demo_town.py``.

The map of a town block that the robot rounded twice, rendered from drifting odometry. The same bytes every time.
"""

from __future__ import annotations

import gzip
import io
import tempfile
from pathlib import Path

import numpy as np

from mapq.cloud import PointCloud
from mapq.configuration import SimulateSettings
from mapq.io import write_ply
from mapq.simulate import simulate

SEED = 5
WORLD = {"street_length": 120.0, "path_length": 60.0, "n_points": 90_000}
"""Besides those of the small world: less street beside the block, and denser points."""
TARGET = Path(__file__).resolve().parent / "demo-town.ply.gz"
KEPT = ("truth", "surface")
"""Fields that the demonstration and the tests read; the others would only make the file larger."""


def main() -> None:
    """Write the map, coordinates in whole millimetres."""
    cloud = simulate(SimulateSettings.of_size("small", WORLD), SEED)
    rounded = np.round(cloud.world(), 3).astype(np.float32)
    slim = PointCloud.from_world(rounded, {name: cloud.fields[name] for name in KEPT})
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "town.ply"
        write_ply(str(plain), slim)
        packed = io.BytesIO()
        with gzip.GzipFile(fileobj=packed, mode="wb", mtime=0) as stream:
            stream.write(plain.read_bytes())
    TARGET.write_bytes(packed.getvalue())
    print(f"wrote {TARGET}: {len(slim)} points, {TARGET.stat().st_size} bytes")


if __name__ == "__main__":
    main()
