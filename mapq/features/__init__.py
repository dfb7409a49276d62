"""The neighbourhood of patches and the features of nodes and edges (paper, section 3.2)."""

from __future__ import annotations

from mapq.features.compute import feature_settings, patch_features
from mapq.features.shape import PatchShapes, measure_shapes

__all__ = ["PatchShapes", "feature_settings", "measure_shapes", "patch_features"]
