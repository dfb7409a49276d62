"""Disagreement of scans by looking at every point and every other scan, with the true normals."""

from __future__ import annotations

import numpy as np

FEWEST = 3
TOLERANCE = 0.15


def brute_disagreement(points, normals, right, used, reach):
    """Return (n,) metres and numbers of other scans that see the surface of each point, scan after scan.

    `points` and `normals` hold an array (n_k, 3) for each scan, in the right map; normals point to the sensor.
    """
    metres, counts = [], []
    moved = used @ np.linalg.inv(right)
    for scan in range(len(points)):
        for place, normal in zip(points[scan], normals[scan], strict=True):
            worst, n_others = 0.0, 0
            for other in range(len(points)):
                if other == scan:
                    continue
                apart = points[other] - place
                near = np.linalg.norm(apart, axis=1) < reach
                same = near & (normals[other] @ normal > 0.8) & (np.abs(apart @ normal) < TOLERANCE)
                if same.sum() < FEWEST:
                    continue
                n_others += 1
                put = [moved[each, :3, :3] @ place + moved[each, :3, 3] for each in (scan, other)]
                worst = max(worst, abs(float(moved[scan, :3, :3] @ normal @ (put[0] - put[1]))))
            metres.append(worst)
            counts.append(n_others)
    return np.array(metres), np.array(counts)
