"""All settings of `mapq`: a table of the settings file is the type that the library takes (docs/configuration.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from prf.shell.cli.settings import Loaded, SettingError, Table, Tree, key
from prf.shell.errors import UsageError

LARGEST, LONGEST = 1e9, 1e6
"""Of metres, degrees and points of a segmentation; and metres of features: squares must be numbers."""
TOLERANCE_IN_NOISE = 3.3
"""Standard deviations: surfaces closer than this cannot be distinguished from one rough surface."""
LARGEST_ERROR = 1e4
"""Metres, and degrees: larger errors of poses are slips."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "us-ft": 1200.0 / 3937.0}
"""Metres in each; the US survey foot is two millionths longer than the foot, which is metres on a grid."""
STORED = {"neighbours": "n_neighbours", "watched": "n_watched"}
"""Feature settings whose names in model files are others."""
IN_MODELS = (
    *("neighbours", "radius", "tau", "eps", "noise", "watched"),
    *("tolerance", "spacing", "up", "context"),
)
"""Feature settings in the order of model files."""

SurfaceKind = Literal["upright", "level", "tilted", "curved"]
SURFACES: tuple[SurfaceKind, ...] = ("upright", "level", "tilted", "curved")
"""Planes up to 30 degrees from vertical, from horizontal, the rest (:func:`mapq.patches.surface_kinds`); cylinders."""
Context = Literal["outlines", "moments", "rays", "copies"]
CONTEXTS: tuple[Context, ...] = ("outlines", "moments", "rays", "copies")
"""Groups of context features, beyond the paper; moments and rays need fields of times or sensors."""


def parse_unit(text: Any) -> Any:
    """Return the metres in a unit: a name of `UNITS`, or a number of metres such as 0.01; ValueError for others."""
    if not isinstance(text, str):
        return text
    name = text.strip().lower()
    try:
        return UNITS[name] if name in UNITS else float(name)
    except ValueError:
        raise ValueError(f"must be one of {', '.join(UNITS)}, or how many metres it is") from None


def parse_share(text: Any) -> Any:
    """Return the share in ``0.05`` or ``5%``; ValueError if it is neither, or not between 0 and 1."""
    number = str(text).strip().removesuffix("%").rstrip()
    try:
        share = float(number) / (100.0 if number != str(text).strip() else 1.0)
    except ValueError:
        share = math.nan
    if not 0.0 <= share <= 1.0:
        raise ValueError("must be a share between 0 and 1 such as 0.05 or 5%")
    return share


def check_direction(up: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a vector that is neither 0, nor so short or long that squares are; ValueError for others."""
    if not 1e-100 < max(map(abs, up)) < 1e100:
        raise ValueError("must not be 0 0 0, nor so short or long that squares are")
    return up


def split_words(words: Any) -> Any:
    """Return words of which some are joined by commas, one by one; of a word alone those in it."""
    given = [words] if isinstance(words, str) else words
    return tuple(part.strip() for word in given for part in str(word).split(",")) if isinstance(given, list) else words


Direction = Annotated[tuple[float, float, float], AfterValidator(check_direction)]
Unit = Annotated[float, Field(ge=1e-9, le=1e6), BeforeValidator(parse_unit)]
Share = Annotated[float, BeforeValidator(parse_share)]
NONE: Mapping[str, Any] = MappingProxyType({})
Frontage = Annotated[float, Field(ge=5.0, le=100.0)]
Height = Annotated[float, Field(ge=4.0, le=60.0)]


class ReadOptions(Table):
    """How a cloud is read (docs/clouds.md), by segment, classify, inspect, render, compare and perturb."""

    bin_columns: Literal[3, 4] = key(4, "", "columns of a KITTI .bin: 4 with intensity, or 3")
    unit: Unit | None = key(
        None,
        "m",
        "unit of a cloud's coordinates: m, cm, mm, ft, us-ft, or metres as 0.01",
        "UNIT",
        "that of a LAS file, else m",
    )
    topic: str | None = key(None, "", "topic of the clouds in a ROS bag", "NAME", "the only one")
    frame: str | None = key(None, "", "frame of the map in a ROS bag, to which tf leads; map")

    def refuse_given(self, path: str) -> None:
        """Raise UsageError if anything is given for the PATCHES file `path`, which holds its unit."""
        given = [name for name, value in self if value != getattr(AS_IT_IS, name)]
        if given:
            raise UsageError(f"{path} is segmented already, and holds its unit. Leave out cloud.{given[0]}.")


AS_IT_IS = ReadOptions()
"""No option given."""


class FindSettings(Table):
    """Where posed scans and their poses are."""

    poses: str | None = key(
        None,
        "",
        "poses of the scans: TUM, KITTI, g2o, graph.txt, JSON or other rows",
        "FILE",
        "the file beside the scans",
    )
    calibration: str | None = key(
        None, "", "KITTI's calib.txt; none: poses are the laser's", "FILE", "beside poses or scans"
    )
    pattern: str | None = key(None, "", "which files of a folder are scans: 'planes_*'", "PATTERN")
    quaternion: Literal["xyzw", "wxyz"] | None = key(
        None, "", "order of quaternions in poses; xyzw unless the file has it"
    )
    frame: Literal["sensor", "map"] | None = key(
        None, "", "frame of the points; map: poses give the place of the sensor alone; sensor unless VIEWPOINT decides"
    )


class MergeSettings(Table):
    """How posed scans become a map."""

    voxel: float | None = key(None, "m", "one point of a scan is kept in each cube of this side", gt=0)
    min_range: float | None = key(None, "m", "returns closer to the sensor are dropped", gt=0)
    max_range: float | None = key(None, "m", "returns farther from the sensor are dropped", gt=0)
    submaps: bool = key(False, "", "scans are sub-maps of a drive, without a single sensor", "yes")
    max_points: int = key(10_000_000, "", "of the map; without voxel more are thinned", ge=1)

    def check(self) -> None:
        """Refuse ranges in the wrong order."""
        if (self.min_range or 0.0) >= (self.max_range or math.inf):
            raise SettingError("min_range must be below max_range", "min_range", "max_range")


class ScanSettings(FindSettings, MergeSettings):
    """How posed scans are read and merged (docs/perturb.md), by segment, classify and perturb."""

    every: int = key(1, "", "take scans 0, K, 2K and so on", "K", ge=1)


class SegmentSettings(Table):
    """How a cloud is cut into patches (docs/segmentation.md), by segment and classify."""

    neighbours: int = key(16, "", "nearest neighbours that make a normal", ge=3, le=64)
    resolution: float | None = key(
        None, "m", "side of cells, of each of which one point is looked at first; 0: all", ge=0, le=LARGEST
    )
    noise: float | None = key(None, "m", "standard deviation of points off their surface", ge=0, le=LARGEST)
    max_angle: float | None = key(None, "deg", "between a point's normal and its patch's", gt=0, le=90)
    max_distance: float | None = key(None, "m", "from a point to its patch's plane", gt=0, le=LARGEST)
    max_gap: float | None = key(None, "m", "patches end at wider gaps", gt=0, le=LARGEST)
    max_variation: float | None = key(None, "", "of normals that count: 0 plane, 1/3 ball", gt=0, le=LARGEST)
    min_points: int = key(50, "", "smaller patches are dropped", ge=0, le=int(LARGEST))
    min_extent: float | None = key(None, "m", "narrower patches are dropped", ge=0, le=LARGEST)
    surfaces: Annotated[tuple[SurfaceKind, ...], BeforeValidator(split_words)] = key(
        ("upright", "level"), "", "judged: upright, level, tilted, curved surfaces; by commas", "KIND,...", min_length=1
    )
    up: Direction = key((0.0, 0.0, 1.0), "", "the vertical, of any length")


class FeatureSettings(Table):
    """How patches are measured (docs/features.md), by features and train; classify does as its model."""

    neighbours: int = key(4, "", "closest patches that each patch is joined to", ge=1, le=10_000)
    watched: int = key(
        16, "", "of so many closest patches those are joined too that lie over it or cross it", ge=0, le=10_000
    )
    radius: float = key(3.0, "m", "patches farther apart are not neighbours", gt=0, lt=LONGEST)
    tau: float = key(2.0, "m", "distance over which a pair's weight falls to 1/e", gt=0, lt=LONGEST)
    eps: float = key(0.01, "m", "what the sensor cannot resolve", gt=0, lt=LONGEST)
    noise: float | None = key(None, "m", "standard deviation of points from a surface", gt=0, lt=LONGEST)
    tolerance: float = key(
        0.05, "m", "distance at which surfaces count half as doubled; at least 3.3 noise", gt=0, lt=LONGEST
    )
    spacing: float | None = key(None, "m", "between points", gt=0, lt=LONGEST)
    up: Direction | None = key(None, "", "direction of the z axis of equation 7")
    context: tuple[Context, ...] = key(CONTEXTS, "", "groups of context features: outlines, moments, rays, copies")

    def tolerance_at(self, noise: float) -> float:
        """Return the distance in metres from which surfaces count as doubled: that given, more where noise is."""
        return max(self.tolerance, TOLERANCE_IN_NOISE * noise)

    def stored(self) -> dict[str, Any]:
        """Return the values by the names that model files have."""
        return {STORED.get(name, name): getattr(self, name) for name in IN_MODELS}

    def described(self, noise: float, up: list[float]) -> dict[str, Any]:
        """Return what features were computed with: the settings, and in their places what was estimated.

        `noise`: standard deviation of points from their surface, in metres. `up`: unit vector.
        """
        values = {STORED.get(name, name): value for name, value in self}
        estimated = {"noise": noise, "tolerance": self.tolerance_at(noise), "up": up}
        return {**values, **estimated, "context": list(self.context)}


class TrainSettings(Table):
    """The random field (docs/crf.md), by train; tolerance and max_false_alarms by classify."""

    objective: Literal["pl", "max-margin"] = key(
        "pl", "", "pl: maximum pseudo-likelihood; max-margin: structured support vector machine", "pl|max-margin"
    )
    potential: Literal["trees", "linear"] = key(
        "trees", "", "trees: boosted trees on patches and pairs; linear: a sum over node features"
    )
    edge_model: Literal["symmetric", "none"] = key(
        "symmetric", "", "symmetric: pairs favour equal labels; none: no pairs"
    )
    regularisation: float | None = key(None, "", "precision of each weight's prior", gt=0)
    coupling_regularisation: float | None = key(None, "", "the same, of the coupling", gt=0)
    class_weight: Literal["none", "balanced"] = key(
        "balanced", "", "balanced: both labels weigh the same in sum; none: every patch does"
    )
    folds: int = key(5, "", "of the cross-validation over regions", ge=2)
    tolerance: float | None = key(
        None,
        "m",
        "a surface is wrong if scans, or copies, put it farther apart along its normal; else chosen for the map: 0.1 "
        "where scans are known, 0.3 without, or twice what they resolve",
        "METRES",
        gt=0,
    )
    max_false_alarms: Share | None = key(
        None,
        "",
        "largest share of plausible patches called suspicious, on regions kept out of training: 0.02 or 2%",
        "SHARE",
    )


class SimulateSettings(Table):
    """A simulated map but for its seed (docs/simulation.md), by simulate; defaults are those of --size medium."""

    n_points: int = key(
        560_000,
        "",
        "points of the map, about: beams are left out at random until so many return",
        "N",
        ge=100,
        le=10**11,
    )
    blocks: int = key(1, "", "blocks that the robot drives around, one after the other", ge=1, le=8)
    loops: int = key(2, "", "how often it drives around each block", ge=1, le=5)
    street_length: float = key(340.0, "m", "street lined with offices before each block (region A)", ge=20, le=1000)
    block_length: float = key(44.0, "m", "long side of a block; each varies by a tenth", ge=18, le=500)
    block_depth: float = key(37.0, "m", "short side of a block", ge=16, le=500)
    street_width: float = key(14.0, "m", "from facade to facade", ge=9, le=40)
    path_length: float = key(240.0, "m", "pathway after each block, with the archway (region F)", ge=22, le=1000)
    frontage: tuple[Frontage, Frontage] = key((8.0, 30.0), "m", "shortest and longest facade")
    height: tuple[Height, Height] = key((6.0, 15.0), "m", "lowest and highest building")
    # Gaps between neighbours, fences along facades, free-standing walls seen from both sides.
    look_alikes: float = key(1.0, "", "true geometry that looks like an error of the map; 0: none", ge=0, le=3)
    variety: float = key(0.0, "", "yards with lorries, sheds, balconies, hedges, tanks; 0: offices alone", ge=0, le=3)
    clutter: float = key(1.0, "", "cars, trees, lamp posts and people; 0: none", ge=0, le=3)
    speed: float = key(1.0, "m/s", "of the robot", ge=0.1, le=10)
    all_round: bool = key(False, "", "the laser looks all round, as on cars; else half a turn ahead")
    max_range: float = key(35.0, "m", "longest range of the laser", ge=5, le=200)
    noise: float = key(0.015, "m", "standard deviation of a range", ge=0, le=0.2)
    drift: float = key(
        1.0,
        "",
        "drift of odometry (yaw_bias, yaw_walk, scale_walk), times the usual; 0: a clean map",
        "FACTOR",
        ge=0,
        le=10,
    )
    yaw_bias: float = key(0.6, "deg", "size of the constant heading error after 100 m", ge=0, le=20)
    yaw_walk: float = key(0.2, "deg", "standard deviation of the random walk of the heading after 100 m", ge=0, le=20)
    scale_walk: float = key(0.4, "%", "standard deviation of the wandering error of driven length", ge=0, le=20)
    disagreement: float = key(0.05, "m", "passes over a suspicious surface disagree by more", ge=0.02, le=10)
    cell: float = key(1.0, "m", "side of the cells of each true surface in which passes are compared", ge=0.2, le=10)
    visit_gap: float = key(25.0, "s", "without seeing a cell, after which to see it is another pass", ge=2, le=1000)
    visit_points: int = key(3, "", "points that a pass must have in a cell to count", ge=1, le=1000)

    @classmethod
    def of_size(cls, size: str, changes: Mapping[str, Any] = NONE) -> SimulateSettings:
        """Return the settings of a named size of `SIZES`, with other values of some keys."""
        if size not in SIZES:
            raise UsageError(f"--size {size} is none of {', '.join(SIZES)}, nor city.")
        found = cls(**{**SIZES[size], **changes})
        if found.n_points > MOST_DRIVEN:
            raise UsageError(f"--n-points {found.n_points:,}: a drive has {MOST_DRIVEN:,} at most. Make a --size city.")
        return found


MOST_DRIVEN = 50_000_000
"""Points of a map that a robot drives through."""
SIZES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "small": {
            "n_points": 55_000,
            "street_length": 170.0,
            "block_length": 20.0,
            "block_depth": 18.0,
            "street_width": 11.0,
            "path_length": 120.0,
            "frontage": (7.0, 14.0),
            "height": (5.0, 8.0),
            # A lap is shorter; the second must still end as far from the first.
            "yaw_bias": 0.8,
            "yaw_walk": 0.25,
            # Sparser, so that a pass still has its points in most cells.
            "cell": 2.0,
        },
        "medium": {},
        "large": {"blocks": 2, "n_points": 1_120_000},
    }
)
"""Named sizes; medium is the size of the map of figure 4."""


class PerturbSettings(Table):
    """How scans become a labelled map, and which errors poses get (docs/perturb.md), by perturb."""

    suspicious_above: float = key(0.3, "m", "where scans disagree by more they are suspicious", gt=0, le=100)
    plausible_below: float = key(0.1, "m", "where scans disagree by less they are plausible", gt=0, le=100)
    reach: float | None = key(None, "m", "distance along a surface within which scans see the same", gt=0, le=100)
    search: float = key(3.0, "m", "without right poses: how far off each other scans may lie", gt=0, le=100)
    offset: float = key(0.0, "m", "displace every scan but the first by this", "METRES", ge=0, le=LARGEST_ERROR)
    yaw: float = key(0.0, "deg", "turn every scan but the first about its sensor", "DEG", ge=0, le=LARGEST_ERROR)
    drift: tuple[float, float] = key(
        (0.0, 0.0), "m, deg", "errors that grow along the way, to these at its end", "METRES DEG"
    )
    missed_loop: tuple[float, float] = key(
        (0.0, 0.0), "m, deg", "displace all scans from the first revisit on", "METRES DEG"
    )

    def check(self) -> None:
        """Refuse bounds in the wrong order, and errors without a size."""
        for name in ("drift", "missed_loop"):
            if not all(0.0 <= size <= LARGEST_ERROR for size in getattr(self, name)):
                raise SettingError(f"must be from 0 to {LARGEST_ERROR:g}; the seed gives the signs", name)
        if self.plausible_below > self.suspicious_above:
            raise SettingError("plausible_below must not be above suspicious_above", "plausible_below")

    @property
    def moves_nothing(self) -> bool:
        """Whether all poses stay as they are given."""
        return not (self.offset or self.yaw or any(self.drift) or any(self.missed_loop))


class TileSettings(Table):
    """How a map that outgrows memory is classified in tiles, and by whom (docs/scale.md), by classify."""

    tile_points: int = key(
        2_500_000, "", "points of a tile, about; memory grows with it: 3 GB a worker for these", "N", ge=10_000
    )
    workers: int = key(1, "", "processes that work on tiles of the map side by side", "N", ge=1, le=1024)
    scheduler: str | None = key(None, "", "Dask scheduler for the tiles, tcp://HOST:8786", "ADDRESS")

    def check(self) -> None:
        """Refuse processes beside a scheduler."""
        if self.scheduler is not None and self.workers != 1:
            raise SettingError("Dask has workers of its own, so workers and scheduler exclude one another", "workers")


class Configuration(Tree):
    """Everything that can be set; None: estimated from the cloud or the patches, or found by cross-validation."""

    PACKAGE: ClassVar[str] = "mapq"

    cloud: ReadOptions = ReadOptions()
    scans: ScanSettings = ScanSettings()
    segment: SegmentSettings = SegmentSettings()
    features: FeatureSettings = FeatureSettings()
    crf: TrainSettings = TrainSettings()
    simulate: SimulateSettings = SimulateSettings()
    perturb: PerturbSettings = PerturbSettings()
    tiles: TileSettings = TileSettings()

    @classmethod
    def flag(cls, place: str) -> str:
        """Return the flag that sets ``TABLE.KEY``."""
        return "--scans" if place == "scans.pattern" else super().flag(place)


def sources_of(loaded: Loaded[Configuration], table: str) -> dict[str, str]:
    """Return key to what has set it, of one table."""
    start = f"{table}."
    return {place.removeprefix(start): each for place, each in loaded.sources.items() if place.startswith(start)}


def typed_keys(loaded: Loaded[Configuration], table: str) -> list[str]:
    """Return the keys of one table that the command line has set, by flags, --set or --preset, and not a file."""
    asked = "--" if loaded.file is not None else ("--", "preset ")
    return [name for name, source in sources_of(loaded, table).items() if source.startswith(asked)]
