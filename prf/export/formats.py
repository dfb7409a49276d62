"""Names of formats and files, and which option goes with which format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath

from prf.shell.errors import UsageError
from prf.shell.files import STREAM

GEOJSON, ROS_MAP, SVG, DXF, NETCDF = FORMATS = ("geojson", "ros-map", "svg", "dxf", "netcdf")
SUFFIXES = {
    GEOJSON: (".geojson", ".json"),
    ROS_MAP: (".yaml", ".yml", ".pgm"),
    SVG: (".svg",),
    DXF: (".dxf",),
    NETCDF: (".nc", ".netcdf"),
}
"""Suffixes of an output that name its format; the first one is that of an output without a name."""
TRINARY, SCALE, RAW = "trinary", "scale", "raw"
IMAGE_SUFFIX = {TRINARY: ".pgm", SCALE: ".png", RAW: ".pgm"}
"""In mode scale an unknown cell is a transparent pixel, which PGM does not have; map_saver writes PNG likewise."""


@dataclass(frozen=True)
class Options:
    """How to export; what is None was not asked for.

    Attributes
    ----------
    format : str or None
        One of `FORMATS`; None: by the suffix of the output.
    draw : int or None
        Number of the draw of a RUN to export instead of its best map or its posterior image, from 0; -1 is the last.
    mode : str or None
        Of a ROS map: "trinary", "scale" or "raw".
    unknown : (float, float) or None
        Of a ROS map: cells of a probability from the first to the second are unknown.
    squares : bool
        Of a ROS map: ask whether a cell is not completely white instead of the colour of its centre.
    resolution : float or None
        Of a ROS map made from one map: side of a cell in metres.
    extrapolate : float or None
        Metres beyond the cells that readings saw up to which a RUN or a GRID is exported as it has it; None: 0.
    """

    format: str | None = None
    draw: int | None = None
    mode: str | None = None
    unknown: tuple[float, float] | None = None
    squares: bool = False
    resolution: float | None = None
    extrapolate: float | None = None


def resolve_format(wanted: str | None, output: str | None) -> str:
    """Return the format `wanted`, or else the one that the suffix of `output` names.

    Raises
    ------
    UsageError
        If neither names one.
    """
    if wanted is not None:
        return wanted
    suffix = "" if output is None else PurePath(output).suffix.lower()
    for name, suffixes in SUFFIXES.items():
        if suffix in suffixes:
            return name
    asked = "no format asked for" if output is None else f"{output}: its suffix names no format"
    raise UsageError(f"{asked}. Give --format {'|'.join(FORMATS)}.")


def check_options(name: str, options: Options) -> None:
    """Refuse options that format `name` has no use for, and values outside their domain (UsageError)."""
    only_ros = {
        "--mode": options.mode is not None,
        "--unknown": options.unknown is not None,
        "--squares": options.squares,
        "--resolution": options.resolution is not None,
    }
    for flag, given in only_ros.items():
        if given and name != ROS_MAP:
            raise UsageError(f"{flag} is for --format {ROS_MAP}, not {name}.")
    if options.extrapolate is not None and name == NETCDF:
        raise UsageError(f"--extrapolate is for maps, not for --format {NETCDF}.")
    if options.extrapolate is not None and not 0.0 <= options.extrapolate < float("inf"):
        raise UsageError(f"--extrapolate {options.extrapolate:g}: must be a number of metres, not negative.")
    if options.draw is not None and name == NETCDF:
        raise UsageError(f"--draw is for maps; --format {NETCDF} holds the values of all draws.")
    if options.unknown is not None:
        low, high = options.unknown
        if not 0.0 <= low <= high <= 1.0:
            raise UsageError(f"--unknown {low:g} {high:g}: needs two probabilities, the lower one first.")
    if options.resolution is not None and not 0.0 < options.resolution < float("inf"):
        raise UsageError(f"--resolution {options.resolution:g}: must be a positive number of metres.")


def targets(name: str, output: str | None, stem: str, mode: str) -> tuple[str, ...]:
    """Return the files that an export writes: one, or for a ROS map the yaml file and the image.

    Parameters
    ----------
    name : str
        The format.
    output : str or None
        As the user gave it. Of a ROS map the name of either file, or their common stem.
    stem : str
        Names the output if the user did not.
    mode : str
        Of a ROS map.

    Raises
    ------
    UsageError
        If a ROS map or a binary file would go to standard output, or the image has a suffix of another mode.
    """
    if output == STREAM and name in (ROS_MAP, NETCDF):
        what = "is a pair of files" if name == ROS_MAP else "is binary"
        raise UsageError(f"--format {name} {what} and cannot go to standard output. Name a file with -o.")
    if name != ROS_MAP:
        return (output if output is not None else stem + SUFFIXES[name][0],)
    given = PurePath(output if output is not None else stem)
    image_suffix = IMAGE_SUFFIX[mode]
    suffix = given.suffix.lower() if output is not None else ""
    if suffix in IMAGE_SUFFIX.values() and suffix != image_suffix:
        raise UsageError(f"{output}: the image of mode {mode} is a {image_suffix} file. Name the yaml file instead.")
    if suffix in (".yaml", ".yml"):
        return str(given), str(given.with_suffix(image_suffix))
    base = str(given.with_suffix("")) if suffix == image_suffix else str(given)
    return f"{base}.yaml", f"{base}{image_suffix}"
