"""Pictures of runs and of maps; matplotlib is imported when a picture is drawn."""

from prf.render.maps import render_best, render_draws, render_maps
from prf.render.posterior import render_cells, render_posterior
from prf.render.readings import render_beams

__all__ = ["render_beams", "render_best", "render_cells", "render_draws", "render_maps", "render_posterior"]
