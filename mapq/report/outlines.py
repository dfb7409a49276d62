"""Outlines of patches: convex polygons around their points, seen along their normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

N_DIRECTIONS = 24
"""In so many directions the outermost point of a patch is a corner: its hull, but for corners blunter than 15°."""


def outlines(
    xyz: NDArray[np.float64], start: NDArray[np.int64], normal: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the corners (h, 3) of the outlines of m patches, and where (m + 1,) each one's begin.

    Parameters
    ----------
    xyz : (n, 3) float64
        Points, patch after patch.
    start : (m + 1,) int64
        Where each patch's points begin.
    normal : (m, 3) float64
        A patch whose normal is not finite, or whose points lie on a line, has no outline.
    """
    n_patches = len(start) - 1
    counts = np.diff(start)
    across, along = _axes(normal)
    owner = np.repeat(np.arange(n_patches), counts)
    u, v = (np.einsum("ij,ij->i", xyz, axis[owner]) for axis in (across, along))
    corner = np.full((n_patches, N_DIRECTIONS), -1, np.int64)
    filled = np.flatnonzero((counts > 2) & np.isfinite(normal).all(axis=1))
    for step in range(N_DIRECTIONS if len(filled) else 0):
        angle = 2.0 * np.pi * step / N_DIRECTIONS
        corner[filled, step] = _outermost(np.cos(angle) * u + np.sin(angle) * v, start, owner)[filled]
    # A corner that is outermost in several directions stands once; they follow one another.
    new = (corner != np.roll(corner, 1, axis=1)) & (corner >= 0)
    new[new.sum(axis=1) < 3] = False
    begin = np.concatenate([[0], np.cumsum(new.sum(axis=1))]).astype(np.int64)
    return xyz[corner[new]], begin


def _axes(normal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two unit vectors (m, 3) across each normal and each other."""
    least = np.argmin(np.abs(np.nan_to_num(normal)), axis=1)
    across = np.cross(normal, np.eye(3)[least])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return across, np.cross(normal, across)


def _outermost(reach: NDArray[np.float64], start: NDArray[np.int64], owner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first point (m,) of the largest reach of each patch; of a patch without points something else."""
    largest = np.maximum.reduceat(np.append(reach, -np.inf), start[:-1])
    top = np.flatnonzero(reach == largest[owner])
    first = np.ones(len(top), np.bool_)
    first[1:] = owner[top[1:]] != owner[top[:-1]]
    found = np.zeros(len(start) - 1, np.int64)
    found[owner[top[first]]] = top[first]
    return found
