"""Node features: how well a patch's points make a plane (equations 6 to 8, safe reading)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes

NODE_NAMES = ("fit", "tilt", "thickness")
SHAPE_NAMES = ("n_points", "rms_m", "thickness_m", "area_m2", "width_m", "height_m", "tilt_deg")
"""Measures of a patch for people: a count, metres, m², and degrees."""


def node_features(shapes: PatchShapes, settings: FeatureSettings) -> NDArray[np.float64]:
    """Return the features (m, 3) named by `NODE_NAMES`.

    fit (equation 6): -log((MSE + eps²) / (sigma² + eps²)), sigma the noise of the map; high is flat.
    tilt (equation 7): 1 - |up . n|; 1 is upright.
    thickness (equation 8): -log((eps + P95 - P5 of the signed distance from the plane) / (eps + sigma)); high is thin.

    In times the noise, as in metres a model would learn the sensors of its training maps.
    """
    noise = shapes.noise(settings)
    fit = -np.log((shapes.mse + settings.eps**2) / (noise**2 + settings.eps**2))
    tilt = 1.0 - shapes.up_cosine
    thickness = -np.log((settings.eps + shapes.thickness) / (settings.eps + noise))
    return np.column_stack([fit, tilt, thickness])


def shape_table(shapes: PatchShapes) -> NDArray[np.float64]:
    """Return the measures (m, 7) named by `SHAPE_NAMES`; tilt in degrees from the vertical, 0 for upright planes."""
    tilt = np.degrees(np.arcsin(shapes.up_cosine))
    rms = np.sqrt(shapes.mse)
    columns = [shapes.counts, rms, shapes.thickness, shapes.area, shapes.width, shapes.height, tilt]
    return np.column_stack([np.asarray(column, np.float64) for column in columns])
