"""Pictures of runs and of maps; matplotlib is imported when a picture is drawn."""

from prf.output.pictures.maps import render_best, render_draws, render_maps
from prf.output.pictures.places import render_places
from prf.output.pictures.posterior import plot_posterior, render_beams, render_cells, render_posterior

__all__ = [
    "plot_posterior",
    "render_beams",
    "render_best",
    "render_cells",
    "render_draws",
    "render_maps",
    "render_places",
    "render_posterior",
]
