"""The neighbourhood of patches and the features of nodes and edges (paper, section 3.2)."""

from __future__ import annotations

from mapq.features.compute import patch_features
from mapq.features.settings import FeatureSettings, Reading, feature_settings
from mapq.features.shape import PatchShapes, measure_shapes

__all__ = ["FeatureSettings", "PatchShapes", "Reading", "feature_settings", "measure_shapes", "patch_features"]
