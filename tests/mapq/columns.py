"""A room with round columns that scans from around see, some of them displaced."""

from __future__ import annotations

import numpy as np

from mapq.cloud import PointCloud
from mapq.configuration import SegmentSettings
from tests.mapq.factories import Rectangle, wall

CURVED = SegmentSettings(surfaces=("upright", "level", "curved"))
NOISE, HEIGHT, N_SCANS = 0.01, 3.0, 6
COLUMNS = ((3.0, 4.0, 0.3), (6.0, 4.0, 0.5), (9.5, 4.0, 1.0))
"""Place and radius in metres."""
ROOM = [
    *(wall(*line, HEIGHT) for line in (((0, 0), (12, 0)), ((12, 0), (12, 8)), ((12, 8), (0, 8)), ((0, 8), (0, 0)))),
    Rectangle((6.0, 4.0, 0.0), (1, 0, 0), (0, 1, 0), 12.0, 8.0),
]
SENSORS = np.array([(1.0, 1.0), (4.5, 1.0), (11.0, 1.0), (11.0, 7.0), (7.5, 7.0), (1.0, 7.0)])


def column(
    rng: np.random.Generator, place: tuple[float, ...], n: int, towards: float = 0.0, half: float = np.pi
) -> np.ndarray:
    """Return points (n, 3) of a column at x, y of a radius, within half an arc in radians of a direction."""
    angle = towards + rng.uniform(-half, half, n)
    away = place[2] + rng.normal(0.0, NOISE, n)
    return np.column_stack(
        [place[0] + away * np.cos(angle), place[1] + away * np.sin(angle), rng.uniform(0.0, HEIGHT, n)]
    )


def scanned(shift: tuple[float, float] = (0.0, 0.0), columns=COLUMNS, density: float = 40.0) -> PointCloud:
    """Return a map of scans, of which the second, fourth and sixth lie displaced."""
    rng, parts, scan = np.random.default_rng(0), [], []
    for number, sensor in enumerate(SENSORS):
        points = [each.sample(rng, density, NOISE) for each in ROOM]
        for each in columns:
            towards = np.arctan2(*(sensor - each[:2])[::-1])
            points.append(column(rng, each, int(5.0 * density * each[2] * HEIGHT), towards, 1.3))
        parts.append(np.vstack(points) + (number % 2) * np.array([*shift, 0.0]))
        scan.append(np.full(len(parts[-1]), number))
    xyz, moment = np.vstack(parts), np.concatenate(scan)
    at = np.column_stack([SENSORS, np.full(N_SCANS, 1.5)]) + (np.arange(N_SCANS) % 2)[:, None] * [*shift, 0.0]
    away = at[moment] - xyz
    return PointCloud.from_world(xyz, {"scan": moment, **{f"to_sensor_{a}": away[:, k] for k, a in enumerate("xyz")}})
