"""All settings of `prf`, a model a table of the settings file (docs/configuration.md)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self

from pydantic import field_validator

from prf.model.sensors import (
    FACTOR,
    LARGEST_RANGE,
    LENGTH,
    MOST_ORIENTATION,
    LaserModel,
    PointModel,
    SonarModel,
    window_fault,
)
from prf.shell.cli.settings import Loaded, SettingError, Table, Tree, build, key, places_of
from prf.shell.errors import ArgumentError

DrivenPoses = Literal["used", "all"]
Start = Literal["empty", "grid", "prior"]

ODOMETRY = {
    "precise": (0.01, 0.002, 0.01, 0.01),
    "wheels": (0.05, 0.01, 0.03, 0.03),
    "poor": (0.2, 0.05, 0.1, 0.1),
}
"""Noise of odometry, by name: radians per root radian turned, radians per root metre driven, metres per root metre
driven, metres per root radian turned. Variances add up along the way, however finely a log divides it."""
MAX_SCALE = 1e6
"""1/m: walls a micrometre apart."""

SCORE_DEFAULTS: Mapping[str, float] = MappingProxyType(
    {"laser.noise": 0.05, "laser.noise_relative": 0.0, "laser.miss_probability": 0.0}
)
"""Of a configuration by which maps are scored, where they differ from those of a sampler."""


class Prior(Table):
    """The law of maps: the Arak process of polygons, or walls (docs/walls.md)."""

    scale: float = key(
        0.1,
        "1/m",
        "scale parameter p; the expected length of edges is pi p a square metre",
        flag="1/METRE",
        gt=0.0,
        le=MAX_SCALE,
    )
    window: tuple[float, float, float, float] | None = key(
        None,
        "m",
        "window of the map in metres: x_min, y_min, x_max, y_max",
        flag="X0 Y0 X1 Y1",
        unset="all sensors and 99.5 % of the returns + 1 m",
    )

    orientation: float | Literal["sampled"] = key(
        0.0,
        "",
        "how much edges prefer two directions at right angles, from 0; sampled: as the readings tell",
    )
    orientation_angle: float | Literal["sampled"] = key("sampled", "rad", "one of these directions, or sampled")
    free_space: float = key(0.0, "1/m²", "cost of black ground, nats a square metre", ge=0.0, le=1e6)
    map: Literal["polygons", "walls"] = key(
        "polygons", "", "what a map is: polygons (the Arak process), or walls with a thickness", flag="polygons|walls"
    )
    wall_density: float = key(0.4, "1/m²", "walls: their rate before interactions", gt=0.0, le=1e6)
    wall_length: float = key(1.5, "m", "walls: median length before interactions", **LENGTH)
    wall_thickness: float = key(0.12, "m", "walls: median of the common values of thickness", ge=0.02, le=1.0)
    free_end: float = key(0.5, "", "walls: cost of an end that is joined to no wall, nats", ge=0.0, le=1e6)
    crossing: float = key(3.0, "", "walls: cost of a crossing without a joint, nats", ge=0.0, le=1e6)

    @property
    def is_walls(self) -> bool:
        """Whether a map is one of walls."""
        return self.map == "walls"

    def check(self) -> None:
        """Refuse what walls do not have."""
        if self.is_walls and self.free_space > 0.0:
            raise SettingError("walls have no cost of black ground: leave out free_space, or map", "free_space", "map")

    @field_validator("orientation")
    @classmethod
    def _is_strength(cls, strength: float | str) -> float | str:
        if isinstance(strength, float) and not 0.0 <= strength <= MOST_ORIENTATION:
            raise ValueError(f"must be from 0 to {MOST_ORIENTATION:g}, or sampled")
        return strength

    @field_validator("window")
    @classmethod
    def _is_window(cls, window: tuple[float, float, float, float] | None) -> tuple[float, float, float, float] | None:
        if window is not None and (fault := window_fault(window)):
            raise ValueError(fault)
        return window


class Thinning(Table):
    """Which beams of a dense log are used (docs/large-jobs.md)."""

    beam_density: float | None = key(
        None,
        "1/m²",
        "beams of a laser a square metre of seen ground, about; 0: all of them",
        unset="16; with uncertain poses all of them, up to 100,000",
        ge=0.0,
    )


class ReadingOptions(Table):
    """Which readings of the logs are used (docs/readings.md)."""

    topic: str | None = key(
        None,
        "",
        "laser: topic of a bag, device of a Player log, kind of CARMEN lines",
        flag="NAME",
        unset="all, in a bag the only one",
    )
    sonar_topic: str | None = key(None, "", "the same of the sonar's log, in a bag several with commas")
    frame: str | None = key(
        None,
        "",
        "frame, or topic of poses, that poses are taken in; with poses of a file what these are of",
        flag="NAME",
        unset="map",
    )
    poses: tuple[str, ...] = key(
        (),
        "",
        "file of poses (TUM, KITTI, g2o, CSV, x y theta), for scans that have none or worse ones; several: one a log",
        flag="FILE",
    )
    pose_mount: tuple[float, float, float] | None = key(
        None, "m, m, rad", "x, y, theta of the laser (of a sonar ring: of the robot) on what the poses are of"
    )
    pose_gap: float = key(2.0, "s", "longest time between two poses of the file that is interpolated over", ge=0.0)
    pose_offset: float = key(0.0, "s", "added to the times of the file of poses")
    pose_quaternion: Literal["xyzw", "wxyz"] | None = key(
        None, "", "xyzw or wxyz: order of quaternions in the file of poses"
    )
    beam_angles: str | None = key(
        None, "degrees", "where the beams point of ranges alone, a row a scan", flag="FIRST:STEP:LAST"
    )
    every_scan: int = key(1, "", "scans 0, K, 2K and so on", flag="K", ge=1)
    every_beam: int = key(1, "", "beams 0, K, 2K and so on", flag="K", ge=1)
    scans: str | None = key(None, "", "only these scans, START:STOP:STEP", flag="START:STOP:STEP")
    skip_scans: str | None = key(None, "", "all scans but these, START:STOP:STEP", flag="START:STOP:STEP")

    @field_validator("poses", mode="before")
    @classmethod
    def _is_list(cls, poses: Any) -> Any:
        return () if poses is None else (poses,) if isinstance(poses, str) else tuple(poses)

    def selection(self) -> dict[str, Any]:
        """Return which scans and beams to take, as arguments of :func:`prf.readings.ground.thin`."""
        return self.model_dump(include={"every_scan", "every_beam", "scans", "skip_scans"})


class Driven(Table):
    """What follows from the way driven (docs/driven-way.md)."""

    radius: float | None = key(
        None,
        "m",
        "radius of the disc round the sensor that was free all along the way driven; 0: not known",
        flag="METRES",
        unset="0.1; 0 with uncertain poses",
        ge=0.0,
        le=LARGEST_RANGE,
    )
    poses: DrivenPoses = key(
        "used", "", "the way driven: of the scans in use (used), or of the whole log (all)", flag="used|all"
    )


class PoseOptions(Table):
    """Poses that are uncertain, and sampled with the map (docs/poses.md)."""

    pose_noise: tuple[float, float] | Literal["auto"] | None = key(
        None,
        "m, rad",
        "standard deviations of independent errors of the given poses; auto: as scans disagree",
        flag="METRES RADIANS|auto",
    )
    odometry: Literal["precise", "wheels", "poor"] | None = key(
        None, "", "the given poses are odometry of this kind: precise, wheels, poor", flag="KIND"
    )
    file: str | None = key(None, "", "file of the odometry, as --poses takes one, where the poses are of another")
    odometry_noise: tuple[float, float, float, float] | None = key(
        None, "rad/√rad, rad/√m, m/√m, m/√rad", "the same by its numbers: turn by turn, by way; way by way, by turn"
    )

    @field_validator("pose_noise", "odometry_noise")
    @classmethod
    def _are_positive(cls, values: tuple[float, ...] | str | None) -> tuple[float, ...] | str | None:
        if isinstance(values, tuple) and not all(value > 0.0 for value in values):
            raise ValueError("standard deviations must be above 0")
        return values

    def check(self) -> None:
        """Refuse a file of odometry whose errors are not known."""
        if self.file is not None and self.step_noise is None:
            raise SettingError("how far odometry errs is not given. Add --odometry precise, wheels or poor", "file")

    @property
    def is_uncertain(self) -> bool:
        """Whether poses are sampled."""
        return self.pose_noise is not None or self.step_noise is not None

    @property
    def step_noise(self) -> tuple[float, float, float, float] | None:
        """The four numbers of the odometry; None where the given poses are not odometry."""
        return self.odometry_noise or (None if self.odometry is None else ODOMETRY[self.odometry])


class ChainOptions(Table):
    """The chains (docs/convergence.md, docs/large-jobs.md)."""

    chains: int = key(4, "", "independent chains", flag="N", ge=1, le=10_000)
    resolution: float | None = key(
        None, "m", "side of a pixel of the image", flag="METRES", unset="fits the window", **LENGTH
    )
    tiles: int | None = key(
        None, "", "tiles in which a chain is updated at once, for large windows; 0: none", ge=0, le=1024
    )
    start: Start | None = key(None, "", "where chains start: empty, grid (contour of one) or prior")
    temperatures: int | Literal["auto"] = key(
        1, "", "temperatures of parallel tempering a chain; auto: several once chains disagree"
    )
    lowest_inverse_temperature: float | None = key(
        None, "", "power of the likelihood on the hottest chain; 0: the prior", ge=0.0, lt=1.0
    )

    @field_validator("tiles")
    @classmethod
    def _is_division(cls, tiles: int | None) -> int | None:
        if tiles == 1:
            raise ValueError("must be 0, or from 2 to 1024")
        return tiles

    @field_validator("temperatures")
    @classmethod
    def _is_ladder(cls, temperatures: int | str) -> int | str:
        if isinstance(temperatures, int) and not 1 <= temperatures <= 1_000:
            raise ValueError("must be from 1 to 1000")
        return temperatures

    def check(self) -> None:
        """Refuse tiles beside several temperatures."""
        if self.is_tempered and self.tiles:
            raise SettingError(
                "tempered chains have no tiles: leave out temperatures or tiles", "tiles", "temperatures"
            )

    @property
    def is_tempered(self) -> bool:
        """Whether chains have several temperatures, or may come to have some."""
        return isinstance(self.temperatures, str) or self.temperatures > 1


class GridOptions(Table):
    """Occupancy grids (docs/scores.md)."""

    method: Literal["count", "log-odds"] = key("count", "", "count hits and misses, or add clamped log odds")
    resolution: float = key(0.1, "m", "side of a cell", flag="METRES", gt=0.0)
    no_return: Literal["free", "ignore"] = key("ignore", "", "what laser beams without return mean for their cells")
    hit_probability: float = key(0.7, "", "log-odds: occupied, given one hit", gt=0.5, lt=1.0)
    miss_probability: float = key(0.4, "", "log-odds: occupied, given one miss", gt=0.0, lt=0.5)
    clamp: float = key(3.5, "", "log-odds: stay within plus and minus this", gt=0.0)
    sonar_thickness: float = key(0.2, "m", "depth of the arc that a sonar reading marks", gt=0.0)


class Cooling(Table):
    """The search for the best map: how its temperature falls (docs/scores.md)."""

    warm: float = key(0.3, "", "share of the work at temperature 1, in which chains find their way", ge=0.0, lt=1.0)
    polish: float = key(0.15, "", "share at temperature 0, at the end, which accepts no loss", ge=0.0, lt=1.0)
    coldest: float = key(0.003, "", "temperature before the last steps", gt=0.0, lt=1.0)

    def check(self) -> None:
        """Refuse a schedule that leaves no time to cool."""
        if self.warm + self.polish >= 1.0:
            raise SettingError("the shares of warm and polish must sum to less than 1", "warm", "polish")


class LaserPhysics(Table):
    """A simulated laser; what it reads follows the density that `prf sample` assumes."""

    beams: int = key(180, "", "of a scan of the laser", ge=2, le=100_000)
    # Half a circle is laid out as CARMEN does; a full one leaves out its last beam, which would be the first; others
    # have a beam at both ends.
    field_of_view: float = key(math.pi, "rad", "of the laser, symmetric to ahead", gt=0.0, le=2.0 * math.pi + 1e-9)
    max_range: float = key(30.0, "m", "of the laser", **LENGTH)
    noise: float = key(0.03, "m", "standard deviation of a range of the laser", ge=0.0, le=FACTOR["le"])
    noise_relative: float = key(0.01, "", "the same as a share of the distance", ge=0.0, le=FACTOR["le"])
    # The window that `prf sample` takes by default leaves 0.5 % of the returns outside: more outliers than that beyond
    # the walls widen it.
    outlier_probability: float = key(0.003, "", "share of outliers of the laser", ge=0.0, le=1.0)
    miss_probability: float = key(0.02, "", "share of the laser's beams without return from a wall", ge=0.0, le=1.0)

    def check(self) -> None:
        """Refuse shares of more than all readings."""
        if self.outlier_probability + self.miss_probability > 1.0:
            names = ("outlier_probability", "miss_probability")
            raise SettingError("outlier and miss probability must sum to at most 1", *names)


class SimulationOptions(LaserPhysics):
    """Robot, laser and sonar of a simulation (docs/simulation.md), by simulate."""

    robot_radius: float = key(0.25, "m", "distance kept from walls", **LENGTH)
    spacing: float | None = key(None, "m", "driven from scan to scan; 0.5, or for --readings in one drive", **LENGTH)
    sonar_max_range: float = key(8.0, "m", "of the sonar", **LENGTH)

    def laser(self) -> LaserPhysics:
        """Return the laser alone."""
        return LaserPhysics(**self.model_dump(include=set(LaserPhysics.model_fields)))


RENAMED: Mapping[str, str] = {"trajectory.file": "odometry_file", "prior.map": "prior"}
PREFIXES: Mapping[str, str] = {"sonar": "sonar_", "points": "points_", "driven": "driven_"}
"""Before the keys of these tables in manifests and flags; nothing for others."""
IN_MANIFEST = ("prior", "laser", "sonar", "points", "thinning", "readings", "driven", "trajectory", "sampler")


class Configuration(Tree):
    """Everything that can be set; None: from the log, or estimated."""

    PACKAGE: ClassVar[str] = "prf"

    prior: Prior = Prior()
    laser: LaserModel = LaserModel()
    sonar: SonarModel = SonarModel()
    points: PointModel = PointModel()
    thinning: Thinning = Thinning()
    readings: ReadingOptions = ReadingOptions()
    driven: Driven = Driven()
    trajectory: PoseOptions = PoseOptions()
    sampler: ChainOptions = ChainOptions()
    grid: GridOptions = GridOptions()
    anneal: Cooling = Cooling()
    simulate: SimulationOptions = SimulationOptions()

    @classmethod
    def flag(cls, place: str) -> str:
        """Return the flag that sets ``TABLE.KEY``."""
        return "--" + flat_name(place).replace("_", "-")

    def flat(self, read: Iterable[str] = IN_MANIFEST) -> dict[str, Any]:
        """Return the values of these tables and keys as manifests have them."""
        return {flat_name(place): self.get(place) for place in places_of(Configuration, read)}

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Return the configuration with these values, by the names that manifests have."""
        return cls().replace(**values)

    def replace(self, **changes: Any) -> Self:
        """Return the configuration with other values, by the names that manifests have; ArgumentError names one."""
        places = {flat_name(place): place for place in places_of(Configuration, IN_MANIFEST)}
        values = self.model_dump(exclude_none=True)
        for name, value in changes.items():
            if name not in places:
                raise ArgumentError(f"{name}: unknown setting.")
            table, each = places[name].split(".")
            values[table][each] = value
        return build(type(self), values, {place: name for name, place in places.items()}, ArgumentError)


def flat_name(place: str) -> str:
    """Return the name of ``TABLE.KEY`` in manifests and, with dashes, of its flag."""
    table, name = place.split(".")
    return RENAMED.get(place) or PREFIXES.get(table, "") + name


def named_sources(loaded: Loaded[Configuration]) -> dict[str, str]:
    """Return what has set which value, by the names of manifests."""
    return {flat_name(place): source for place, source in loaded.sources.items()}
