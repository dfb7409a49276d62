"""The rays of a whole map that are followed: of all patches one after the other, every n-th."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.features.provenance import Known, views_of
from mapq.features.rays import Rays, has_ray, take_rays
from mapq.features.settings import FeatureSettings
from mapq.features.shape import measure_shapes
from mapq.scale.files import save_arrays
from mapq.scale.gather import Part, gather
from mapq.scale.patches import load_whole

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class RayTask(NamedTuple):
    """What the drawing of rays is given.

    Attributes
    ----------
    number : int
        Of the file that is written.
    patches : (c,) int64
        Ascending.
    step : int
        Of so many one is followed.
    settings : FeatureSettings
    part : Part
    known : Known
    """

    number: int
    patches: Ints
    step: int
    settings: FeatureSettings
    part: Part
    known: Known


def draw_part(task: RayTask) -> Floats:
    """Write the rays to some patches, and return the spacing (c,) of these patches in metres."""
    whole = load_whole(task.part.folder)
    patches = gather(whole, task.patches, task.part)
    shapes = measure_shapes(patches, task.settings)
    views = views_of(patches.cloud, shapes.number, task.known)
    assert views is not None
    with_ray = np.flatnonzero(has_ray(views.to_sensor))
    patch = np.repeat(np.arange(len(shapes)), shapes.counts)[with_ray]
    thinned = np.array([task.part.step_of(int(n)) for n in whole.n_points[task.patches]], np.int64)[patch]
    # Of a patch that is thinned a ray stands for several.
    drawn = np.arange(len(patch)) % np.maximum(task.step // thinned, 1) == 0
    rays = take_rays(shapes, views, with_ray[drawn])
    named = rays._replace(patch=task.patches[rays.patch])._asdict()
    save_arrays(_path(task.part.folder, task.number), **named)
    return shapes.spacing


def rays_near(folder: str, n_files: int, box: Floats, chosen: Ints) -> Rays:
    """Return the rays whose boxes touch a box (2, 3), with their patches' places among some (c,), ascending."""
    parts = []
    for number in range(n_files):
        with np.load(_path(folder, number)) as arrays:
            rays = Rays(**{name: arrays[name] for name in Rays._fields})
        low, high = np.minimum(rays.sensor, rays.hit), np.maximum(rays.sensor, rays.hit)
        some = ((low <= box[1]) & (high >= box[0])).all(axis=1)
        parts.append([values[some] for values in rays])
    found = Rays(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
    place = np.minimum(np.searchsorted(chosen, found.patch), len(chosen) - 1)
    return found._replace(patch=np.where(chosen[place] == found.patch, place, -1))


def _path(folder: str, number: int) -> str:
    return os.path.join(folder, f"rays_{number:05d}.npz")
