"""How plausible a point cloud map is, plane patch by plane patch."""

from prf import __version__ as __version__
