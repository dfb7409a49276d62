"""Maps for other programs: GeoJSON, ROS map_server, SVG, DXF, and the functionals as netCDF for ArviZ."""

from prf.export.drive import Exported, File, export_source
from prf.export.formats import FORMATS, Options

__all__ = ["FORMATS", "Exported", "File", "Options", "export_source"]
