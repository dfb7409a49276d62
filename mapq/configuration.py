"""All settings of `mapq`, a model a table of the settings file (docs/configuration.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from mapq.crf.settings import TrainSettings
from mapq.features.settings import CONTEXTS, FeatureSettings
from mapq.io.options import ReadOptions
from mapq.posed.merge import MergeSettings
from mapq.segmentation.settings import SegmentSettings
from prf.shell.cli.settings import Loaded, Table, Tree, key, load_options
from prf.shell.errors import UsageError

Direction = tuple[float, float, float]


class Segment(Table):
    """How a cloud is cut into patches (docs/segmentation.md), by segment and classify."""

    neighbours: int = key(16, "", "nearest neighbours that make a normal")
    resolution: float | None = key(None, "m", "side of cells, of each of which one point is looked at first; 0: all")
    noise: float | None = key(None, "m", "standard deviation of points off their surface")
    max_angle: float | None = key(None, "deg", "between a point's normal and its patch's")
    max_distance: float | None = key(None, "m", "from a point to its patch's plane")
    max_gap: float | None = key(None, "m", "patches end at wider gaps")
    max_variation: float | None = key(None, "", "of normals that count: 0 plane, 1/3 ball")
    min_points: int = key(50, "", "smaller patches are dropped")
    min_extent: float | None = key(None, "m", "narrower patches are dropped")
    max_tilt: float = key(30.0, "deg", "planes farther from vertical are dropped; 90 keeps all")
    up: Direction = key((0.0, 0.0, 1.0), "", "the vertical, of any length")

    def check(self) -> None:
        """Refuse values outside their domains."""
        self.settings().check()

    def settings(self) -> SegmentSettings:
        """Return what the segmentation takes."""
        return SegmentSettings(**self.model_dump())


class Cloud(Table):
    """How a cloud is read (docs/clouds.md), by segment, classify, inspect, render, compare and perturb."""

    bin_columns: Literal[3, 4] = key(4, "", "columns of a KITTI .bin: 4 with intensity, or 3")
    unit: float | None = key(None, "m", "unit of the coordinates; that of a LAS file, else metres")
    topic: str | None = key(None, "", "topic of the clouds in a ROS bag; the only one")
    frame: str | None = key(None, "", "frame of the map in a ROS bag, to which tf leads; map")

    def check(self) -> None:
        """Refuse values outside their domains."""
        self.options()

    def options(self) -> ReadOptions:
        """Return what readers take."""
        return ReadOptions(**self.model_dump())


class Scans(Table):
    """How posed scans are read and merged (docs/perturb.md), by segment, classify and perturb."""

    quaternion: Literal["xyzw", "wxyz"] | None = key(
        None, "", "order of quaternions in poses; xyzw unless the file has it"
    )
    frame: Literal["sensor", "map"] | None = key(
        None, "", "frame of the points; map: poses give the place of the sensor alone; sensor unless VIEWPOINT decides"
    )
    voxel: float | None = key(None, "m", "one point of a scan is kept in each cube of this side", gt=0)
    min_range: float | None = key(None, "m", "returns closer to the sensor are dropped", gt=0)
    max_range: float | None = key(None, "m", "returns farther from the sensor are dropped", gt=0)
    max_points: int = key(10_000_000, "", "of the map; without voxel more are thinned", ge=1)

    def check(self) -> None:
        """Refuse ranges in the wrong order."""
        if (self.min_range or 0.0) >= (self.max_range or math.inf):
            raise UsageError(f"min_range {self.min_range:g} is not below max_range.")

    def merging(self, submaps: bool) -> MergeSettings:
        """Return how scans become a map."""
        return MergeSettings(**self.model_dump(exclude={"quaternion", "frame"}), submaps=submaps)


class Features(Table):
    """How patches are measured (docs/features.md), by features and train; classify does as its model."""

    reading: Literal["safe", "literal"] = key(
        "safe", "", "safe: bounded features in metres; literal: the equations as printed"
    )
    neighbours: int = key(4, "", "closest patches that each patch is joined to")
    watched: int = key(16, "", "of so many closest patches those are joined too that lie over it or cross it")
    radius: float = key(3.0, "m", "patches farther apart are not neighbours")
    tau: float = key(2.0, "m", "distance over which a pair's weight falls to 1/e")
    eps: float = key(0.01, "m", "what the sensor cannot resolve")
    noise: float | None = key(None, "m", "standard deviation of points from a surface")
    tolerance: float = key(0.05, "m", "distance at which surfaces count half as doubled; at least 3.3 noise")
    spacing: float | None = key(None, "m", "between points")
    up: Direction | None = key(None, "", "direction of the z axis of equation 7")
    context: tuple[str, ...] = key(CONTEXTS, "", "groups of context features: outlines, moments, rays, copies")

    def check(self) -> None:
        """Refuse values outside their domains."""
        self.settings()

    def settings(self) -> FeatureSettings:
        """Return what the features take."""
        values = self.model_dump()
        return FeatureSettings(n_neighbours=values.pop("neighbours"), n_watched=values.pop("watched"), **values)


class Crf(Table):
    """The random field (docs/crf.md), by train; max_false_alarms by classify too."""

    objective: Literal["pl", "max-margin"] = key(
        "pl", "", "pl: maximum pseudo-likelihood; max-margin: structured support vector machine"
    )
    potential: Literal["trees", "linear"] = key(
        "trees", "", "trees: boosted trees on patches and pairs; linear: a sum over node features"
    )
    edge_model: Literal["symmetric", "none"] = key(
        "symmetric", "", "symmetric: pairs favour equal labels; none: no pairs"
    )
    regularisation: float | None = key(None, "", "precision of each weight's prior")
    coupling_regularisation: float | None = key(None, "", "the same, of the coupling")
    class_weight: Literal["none", "balanced"] = key(
        "balanced", "", "balanced: both labels weigh the same in sum; none: every patch does"
    )
    folds: int = key(5, "", "of the cross-validation over regions")
    max_false_alarms: float | None = key(
        None, "", "share of the plausible patches that may be called suspicious", ge=0.0, le=1.0
    )

    def check(self) -> None:
        """Refuse values outside their domains."""
        self.settings()

    def settings(self) -> TrainSettings:
        """Return what training takes; the share of false alarms is not part of it."""
        values = self.model_dump(exclude={"class_weight", "folds", "max_false_alarms"})
        return TrainSettings(balanced=self.class_weight == "balanced", n_folds=self.folds, **values)


class Simulate(Table):
    """What differs from --size (docs/simulation.md), by simulate."""

    blocks: int | None = key(None, "", "blocks that the robot drives around, one after the other")
    loops: int | None = key(None, "", "how often the robot drives around each block")
    look_alikes: float | None = key(None, "", "true walls close to each other, times the usual; 0 for none")
    variety: float | None = key(None, "", "lorries side by side, sheds, balconies, hedges: 3 at most")
    clutter: float | None = key(None, "", "cars, trees, people, times the usual")
    noise: float | None = key(None, "m", "standard deviation of a range")
    all_round: bool | None = key(None, "", "the laser looks all round, as on cars; else half a turn ahead")
    max_range: float | None = key(None, "m", "longest range of the laser")
    disagreement: float | None = key(None, "m", "suspicious is where passes disagree by more along the normal")

    def check(self) -> None:
        """Refuse values outside their domains."""
        given = self.model_dump(exclude_none=True)
        if given:
            from mapq.simulate import Settings  # noqa: PLC0415 - which imports the kernels

            Settings.of_size("medium", given)


class Perturb(Table):
    """How scans become a labelled map (docs/perturb.md), by perturb."""

    suspicious_above: float = key(0.3, "m", "where scans disagree by more they are suspicious", gt=0, le=100)
    plausible_below: float = key(0.1, "m", "where scans disagree by less they are plausible", gt=0, le=100)
    reach: float | None = key(None, "m", "distance along a surface within which scans see the same", gt=0, le=100)
    search: float = key(3.0, "m", "without right poses: how far off each other scans may lie", gt=0, le=100)

    def check(self) -> None:
        """Refuse bounds in the wrong order."""
        if self.plausible_below > self.suspicious_above:
            raise UsageError(f"plausible_below {self.plausible_below:g} is above suspicious_above.")


class Configuration(Tree):
    """Everything that can be set; None: estimated from the cloud or the patches, or found by cross-validation."""

    PACKAGE: ClassVar[str] = "mapq"

    cloud: Cloud = Cloud()
    scans: Scans = Scans()
    segment: Segment = Segment()
    features: Features = Features()
    crf: Crf = Crf()
    simulate: Simulate = Simulate()
    perturb: Perturb = Perturb()


def load_configuration(options: Mapping[str, Any], *tables: str) -> Loaded[Configuration]:
    """Return what a verb that reads `tables` was given, see :func:`~prf.shell.cli.settings.load_options`."""
    return load_options(Configuration, options, tables)


def sources_of(loaded: Loaded[Configuration], table: str) -> dict[str, str]:
    """Return key to what has set it, of one table."""
    start = f"{table}."
    return {place.removeprefix(start): each for place, each in loaded.sources.items() if place.startswith(start)}
