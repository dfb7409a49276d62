"""Pictures of maps: plan view and axonometric 3D view, plausible blue and suspicious red."""

from mapq.render.colours import Scheme, label_colours, patch_colours, probability_colours
from mapq.render.page import render_views
from mapq.render.views import Bounds, axonometric

__all__ = [
    "Bounds",
    "Scheme",
    "axonometric",
    "label_colours",
    "patch_colours",
    "probability_colours",
    "render_views",
]
