"""Maps for other programs: GeoJSON, ROS map_server, SVG, DXF, and the functionals as netCDF for ArviZ."""

from prf.output.export.export import FORMATS, Exported, Options, export_source

__all__ = ["FORMATS", "Exported", "Options", "export_source"]
