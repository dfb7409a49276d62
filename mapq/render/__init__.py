"""Pictures of maps: plan view and axonometric 3D view, plausible blue and suspicious red."""

from mapq.render.picture import Picture
from mapq.render.source import picture_of, read_picture

__all__ = ["Picture", "picture_of", "read_picture"]
