"""All settings of `prf`, a model a table of the settings file (docs/configuration.md)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, ClassVar, Literal, Self

from prf.model.arak import checked_scale
from prf.model.laser import LaserModel
from prf.model.points import PointModel
from prf.model.sonar import SonarModel
from prf.model.window import LARGEST_RANGE, Window
from prf.poses.model import ODOMETRY
from prf.readings import CONE, GivenPoses, read_poses
from prf.readings.poses import GAP
from prf.readings.thinning import BEAM_DENSITY
from prf.shell.cli.settings import NOTHING, Loaded, Table, Tree, build, key, load_options
from prf.shell.errors import ConfigError
from prf.shell.poses.files import Order

DrivenPoses = Literal["used", "all"]
Start = Literal["empty", "grid", "prior"]


class Prior(Table):
    """The Arak process over maps."""

    scale: float = key(0.1, "1/m", "scale parameter p; the expected length of edges is pi p a square metre")
    window: tuple[float, float, float, float] | None = key(None, "m", "x_min, y_min, x_max, y_max")

    def check(self) -> None:
        """Refuse what is no scale or no window."""
        checked_scale(self.scale)
        if self.window is not None:
            Window.checked(*self.window)


class Laser(Table):
    """Density of a laser reading (docs/sensor-models.md)."""

    max_range: float | None = key(None, "m", "no return from here on")
    noise: float = key(LaserModel.noise, "m", "standard deviation of a range")
    noise_relative: float = key(
        LaserModel.noise_relative, "", "the same as a share of the distance; the larger of the two counts"
    )
    outlier_probability: float = key(LaserModel.outlier_probability, "", "share of outliers, above 0")
    miss_probability: float = key(LaserModel.miss_probability, "", "share of no returns from a wall in range")

    def check(self) -> None:
        """Refuse parameters that make no density, whatever the maximum range of the log."""
        self.model(1.0)

    def model(self, max_range: float | None = None) -> LaserModel:
        """Return the model; `max_range` applies where the table has none."""
        values = self.model_dump()
        return LaserModel(**{**values, "max_range": max_range if self.max_range is None else self.max_range})


class Sonar(Table):
    """Density of a sonar reading (docs/sensor-models.md)."""

    max_range: float = key(SonarModel.max_range, "m", "no return from here on")
    noise: float = key(SonarModel.noise, "m", "standard deviation of a range")
    noise_relative: float = key(
        SonarModel.noise_relative, "", "the same as a share of the distance; the larger of the two counts"
    )
    corner_bias: float = key(SonarModel.corner_bias, "", "log odds that a corner at distance 0 returns the pulse")
    corner_distance: float = key(SonarModel.corner_distance, "1/m", "loss of these log odds with distance")
    surface_bias: float = key(
        SonarModel.surface_bias, "", "log odds that a surface at distance 0, face on, returns the pulse"
    )
    surface_distance: float = key(SonarModel.surface_distance, "1/m", "loss of these log odds with distance")
    surface_oblique: float = key(SonarModel.surface_oblique, "1/rad", "loss away from face on")
    surface_subtended: float = key(SonarModel.surface_subtended, "1/rad", "gain with the angle that the surface fills")
    uniform_probability: float = key(
        SonarModel.uniform_probability, "", "of readings that no feature returned: share uniform up to the maximum"
    )
    short_probability: float = key(
        SonarModel.short_probability, "", "of readings that no feature returned: share of short ones"
    )
    short_length: float = key(SonarModel.short_length, "m", "mean of the short ones")
    cone: float = key(CONE, "rad", "full field of view, where the log has none")

    def check(self) -> None:
        """Refuse parameters that make no density."""
        if not 0.0 < self.cone < math.pi:
            raise ConfigError(f"cone {self.cone}: must lie between 0 and pi radians")
        self.model()

    def model(self) -> SonarModel:
        """Return the model."""
        return SonarModel(**self.model_dump(exclude={"cone"}))


class Points(Table):
    """Density of a point observation (docs/sensor-models.md)."""

    kind: Literal["gaussian", "binary"] | None = key(
        None, "", "gaussian, or binary: the colour itself, 1 for black, perhaps flipped"
    )
    mean_black: float = key(PointModel.mean_black, "", "gaussian: mean of the values in black, in their unit")
    mean_white: float = key(PointModel.mean_white, "", "gaussian: mean of the values in white")
    sigma: float | None = key(None, "", "gaussian: standard deviation round the mean")
    flip_probability: float = key(
        PointModel.flip_probability, "", "binary: share of values that report the other colour, below 0.5"
    )

    def check(self) -> None:
        """Refuse parameters that make no density."""
        self.model()

    def model(self) -> PointModel:
        """Return the model."""
        return PointModel(**self.model_dump())


class Thinning(Table):
    """Which beams of a dense log are used (docs/large-jobs.md)."""

    beam_density: float = key(
        BEAM_DENSITY, "1/m²", "beams of a laser a square metre of seen ground, about; 0: all of them", ge=0.0
    )


class Readings(Table):
    """Which readings of the logs are used (docs/readings.md)."""

    topic: str | None = key(None, "", "laser: topic of a bag, device of a Player log, kind of CARMEN lines")
    sonar_topic: str | None = key(None, "", "the same of the sonar's log, in a bag several with commas")
    frame: str | None = key(
        None, "", "frame, or topic of poses, that poses are taken in; with poses of a file what these are of"
    )
    poses: str | None = key(None, "", "file of poses, for scans that have none or worse ones")
    pose_mount: tuple[float, float, float] | None = key(
        None, "m, m, rad", "x, y, theta of the laser (of a sonar ring: of the robot) on what the poses are of"
    )
    pose_gap: float = key(GAP, "s", "longest time between two poses of the file that is interpolated over", ge=0.0)
    pose_offset: float = key(0.0, "s", "added to the times of the file of poses")
    pose_quaternion: Order | None = key(None, "", "xyzw or wxyz: order of quaternions in the file of poses")
    every_scan: int = key(1, "", "scans 0, K, 2K ...", ge=1)
    every_beam: int = key(1, "", "beams 0, K, 2K ...", ge=1)
    scans: str | None = key(None, "", "START:STOP:STEP, only these scans")
    skip_scans: str | None = key(None, "", "START:STOP:STEP, all but these scans")

    def selection(self) -> dict[str, Any]:
        """Return which scans and beams to take, as arguments of :func:`prf.readings.thinning`."""
        return self.model_dump(include={"every_scan", "every_beam", "scans", "skip_scans"})

    def trajectory(self) -> GivenPoses | None:
        """Return the poses of the file with how they belong to scans; None if there is none."""
        if self.poses is None:
            return None
        found = read_poses(self.poses, self.pose_quaternion)
        return dataclasses.replace(found, mount=self.pose_mount, gap=self.pose_gap, offset=self.pose_offset)


class Driven(Table):
    """What follows from the way driven (docs/driven-way.md)."""

    radius: float = key(0.1, "m", "of the disc that was free all along the way; 0: unknown", ge=0.0, le=LARGEST_RANGE)
    poses: DrivenPoses = key("used", "", "used: the way of the scans in use; all: of the whole log")


class Trajectory(Table):
    """Poses that are uncertain, and sampled with the map (docs/poses.md)."""

    pose_noise: tuple[float, float] | None = key(
        None, "m, rad", "standard deviations of independent errors of the given poses"
    )
    odometry: str | None = key(None, "", f"the given poses are odometry of this kind: {', '.join(ODOMETRY)}")
    odometry_noise: tuple[float, float, float, float] | None = key(
        None, "rad/√rad, rad/√m, m/√m, m/√rad", "the same by its numbers: turn by turn, by way; way by way, by turn"
    )

    def check(self) -> None:
        """Refuse what is no standard deviation, and odometry of no known kind."""
        for name in ("pose_noise", "odometry_noise"):
            values = getattr(self, name)
            if values is not None and not all(value > 0.0 for value in values):
                raise ConfigError(f"{name.replace('_', '-')} {values}: standard deviations must be above 0")
        if self.odometry is not None and self.odometry not in ODOMETRY:
            raise ConfigError(f"odometry {self.odometry}: must be one of {', '.join(ODOMETRY)}")

    @property
    def is_uncertain(self) -> bool:
        """Whether poses are sampled."""
        return self.pose_noise is not None or self.step_noise is not None

    @property
    def step_noise(self) -> tuple[float, float, float, float] | None:
        """The four numbers of the odometry; None where the given poses are none."""
        return self.odometry_noise or (None if self.odometry is None else ODOMETRY[self.odometry])


class Sampler(Table):
    """The chains (docs/convergence.md, docs/large-jobs.md)."""

    chains: int = key(4, "", "independent chains", ge=1, le=10_000)
    resolution: float | None = key(None, "m", "side of a pixel of the image")
    tiles: int | None = key(None, "", "tiles in which a chain is updated at once, for large windows; 0: none", ge=0)
    start: Start | None = key(None, "", "where chains start: empty, grid (contour of one) or prior")
    temperatures: int | Literal["auto"] = key(
        1, "", "temperatures of parallel tempering a chain; auto: several once chains disagree"
    )
    lowest_inverse_temperature: float | None = key(
        None, "", "power of the likelihood on the hottest chain; 0: the prior", ge=0.0, lt=1.0
    )

    def check(self) -> None:
        """Refuse numbers of temperatures that no machine holds, and tiles beside them."""
        if isinstance(self.temperatures, int) and not 1 <= self.temperatures <= 1_000:
            raise ConfigError(f"temperatures {self.temperatures}: must be from 1 to 1000")
        if self.tiles is not None and (self.tiles == 1 or self.tiles > 1024):
            raise ConfigError(f"tiles {self.tiles}: must be 0, or from 2 to 1024")
        if self.is_tempered and self.tiles:
            raise ConfigError(f"tiles {self.tiles}: tempered chains have none. Leave out temperatures or tiles")

    @property
    def is_tempered(self) -> bool:
        """Whether chains have several temperatures, or may come to have some."""
        return isinstance(self.temperatures, str) or self.temperatures > 1


class Grid(Table):
    """Occupancy grids (docs/scores.md)."""

    method: Literal["count", "log-odds"] = key("count", "", "count hits and misses, or add clamped log odds")
    resolution: float = key(0.1, "m", "side of a cell", gt=0.0)
    no_return: Literal["free", "ignore"] = key("ignore", "", "what laser beams without return mean for their cells")
    hit_probability: float = key(0.7, "", "log-odds: occupied, given one hit", gt=0.5, lt=1.0)
    miss_probability: float = key(0.4, "", "log-odds: occupied, given one miss", gt=0.0, lt=0.5)
    clamp: float = key(3.5, "", "log-odds: stay within plus and minus this", gt=0.0)
    sonar_thickness: float = key(0.2, "m", "depth of the arc that a sonar reading marks", gt=0.0)


class Anneal(Table):
    """The search for the best map (docs/scores.md)."""

    coldest: float = key(0.003, "", "temperature before the last steps, which accept no loss")


class Simulate(Table):
    """Robot, laser and sonar of a simulation (docs/simulation.md), by simulate."""

    robot_radius: float = key(0.25, "m", "distance kept from walls")
    spacing: float | None = key(None, "m", "driven from scan to scan; 0.5, or for --readings in one drive")
    beams: int = key(180, "", "of a scan of the laser")
    field_of_view: float = key(math.pi, "rad", "of the laser, symmetric to ahead")
    max_range: float = key(30.0, "m", "of the laser")
    noise: float = key(0.03, "m", "standard deviation of a range of the laser")
    noise_relative: float = key(0.01, "", "the same as a share of the distance")
    outlier_probability: float = key(0.003, "", "share of outliers of the laser")
    miss_probability: float = key(0.02, "", "share of the laser's beams without return from a wall")
    sonar_max_range: float = key(8.0, "m", "of the sonar")


PREFIXES: Mapping[str, str] = {"sonar": "sonar_", "points": "points_", "driven": "driven_"}
"""Before the keys of these tables in manifests and flags; nothing for others."""
IN_MANIFEST = ("prior", "laser", "sonar", "points", "thinning", "readings", "driven", "trajectory", "sampler")


class Configuration(Tree):
    """Everything that can be set; None: from the log, or estimated."""

    PACKAGE: ClassVar[str] = "prf"

    prior: Prior = Prior()
    laser: Laser = Laser()
    sonar: Sonar = Sonar()
    points: Points = Points()
    thinning: Thinning = Thinning()
    readings: Readings = Readings()
    driven: Driven = Driven()
    trajectory: Trajectory = Trajectory()
    sampler: Sampler = Sampler()
    grid: Grid = Grid()
    anneal: Anneal = Anneal()
    simulate: Simulate = Simulate()

    @classmethod
    def flag(cls, place: str) -> str:
        """Return the flag that sets ``TABLE.KEY``."""
        return "--" + flat_name(place).replace("_", "-")

    def flat(self) -> dict[str, Any]:
        """Return the values as manifests have them."""
        return {flat_name(place): self.get(place) for place in _in_manifest()}

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Return the configuration with these values, by the names that manifests have."""
        return cls().replace(**values)

    def replace(self, **changes: Any) -> Self:
        """Return the configuration with other values, by the names that manifests have; ConfigError as :meth:`of`."""
        places = {flat_name(place): place for place in _in_manifest()}
        values = self.model_dump(exclude_none=True)
        for name, value in changes.items():
            if name not in places:
                raise ConfigError(f"{name}: there is no such setting.")
            table, each = places[name].split(".")
            values[table][each] = value
        return build(type(self), values, {place: name.replace("_", "-") for name, place in places.items()})


def flat_name(place: str) -> str:
    """Return the name of ``TABLE.KEY`` in manifests and, with dashes, of its flag."""
    table, name = place.split(".")
    return PREFIXES.get(table, "") + name


def _in_manifest() -> list[str]:
    return [f"{table}.{name}" for table in IN_MANIFEST for name in Configuration.tables()[table].model_fields]


def load_configuration(
    options: Mapping[str, Any],
    defaults: Mapping[str, Any] = NOTHING,
    tables: Sequence[str] = IN_MANIFEST,
) -> Loaded[Configuration]:
    """Return what a verb that reads `tables` was given, see :func:`prf.shell.cli.settings.load_options`."""
    loaded = load_options(Configuration, options, tables, defaults)
    return loaded._replace(settings=without_way(loaded.settings, loaded.sources))


def without_way(settings: Configuration, given: Collection[str]) -> Configuration:
    """Return settings that take nothing from the way driven where poses are uncertain, unless its radius is `given`."""
    is_free = "driven.radius" not in given and settings.driven.radius == Driven().radius
    return settings.replace(driven_radius=0.0) if settings.trajectory.is_uncertain and is_free else settings
