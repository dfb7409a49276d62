"""From a configuration to a simulation: world, drive, readings."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from prf.configuration import LaserPhysics, SimulationOptions
from prf.model.window import Window
from prf.readings.readings import PIONEER, mounted
from prf.shell.cli.storage import spawn_generators
from prf.shell.errors import ConfigError, InputError, UsageError
from prf.simulate.floorplan import office
from prf.simulate.path import SPACING, PathFile, Scans, given_scans, plan_drive, read_path, scans_along
from prf.simulate.roadmap import roadmap
from prf.simulate.sensors import SonarPhysics, simulate_laser, simulate_sonar
from prf.simulate.world import Floats, World, draw_world, read_world

OFFICE, ARAK = "office", "arak"
WORLDS_OF = {"size": (OFFICE, ARAK), "scale": (ARAK,)}
"""Options that matter in some worlds only."""
LASER = tuple(LaserPhysics.model_fields)
SIZE = (60.0, 40.0)
MIN_ROOM = 0.2
"""Share of the window in which the centre of the robot must be able to be, for a draw from the prior to be used."""
MAX_READINGS = 10**9
REACH = 3.5  # metres of way within which a planned drive passes every place
RING_RADIUS = float(np.hypot(*PIONEER[:, :2].T).max())


@dataclasses.dataclass(frozen=True)
class SimulateConfig:
    """What to simulate. Units: metres, radians."""

    world: str = OFFICE  # "office", "arak", or a file (:func:`prf.simulate.world.read_world`)
    size: tuple[float, float] = SIZE  # width and height of an office or of the window of a draw
    scale: float = 0.1  # p of a draw, 1/m
    path: str | None = None  # a file with waypoints or poses; default a drive that is planned
    robot_radius: float = SimulationOptions().robot_radius
    spacing: float | None = None  # metres from scan to scan, and radians where the robot turns; default 0.5
    # about how many readings instead, of the sonar if there is one, else of the laser, spread over the drive
    readings: int | None = None
    laser: LaserPhysics | None = dataclasses.field(default_factory=LaserPhysics)
    sonar: SonarPhysics | None = None
    # pose_noise, odometry_noise: of the poses in the logs, see :func:`given_scans`; default exact ones
    pose_noise: tuple[float, float] | None = None
    odometry_noise: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be simulated."""
        if self.readings is not None and not 1 <= self.readings <= MAX_READINGS:
            raise ConfigError(f"readings {self.readings}: must be at least 1, and at most {MAX_READINGS:,}")
        if self.readings is not None and self.spacing is not None:
            raise ConfigError(
                "readings are spread over one drive: give --readings or --set simulate.spacing=, not both"
            )
        if self.pose_noise is not None and self.odometry_noise is not None:
            raise ConfigError("poses of a log err independently or are odometry: give --pose-noise or --odometry")
        if self.laser is None and self.sonar is None:
            raise ConfigError("no sensor: leave --no-laser out, or add --sonar")
        if self.sonar is not None and self.robot_radius < RING_RADIUS:
            raise ConfigError(f"simulate.robot_radius {self.robot_radius:g}: the sonar ring needs {RING_RADIUS:.3g} m")

    @property
    def readings_per_scan(self) -> int:
        """Of the sensor that `readings` counts."""
        return len(PIONEER) if self.sonar is not None else self.laser.beams if self.laser is not None else 0


def config_of(settings: SimulationOptions, world: str, laser: bool, sonar: bool, **options: Any) -> SimulateConfig:
    """Return what settings and options ask for; UsageError for an option that has no effect in this world.

    `laser`, `sonar`: whether the robot has them. `options`: other fields of :class:`SimulateConfig`; None: the default.
    """
    given = {name: value for name, value in options.items() if value is not None}
    for name, worlds in WORLDS_OF.items():
        if name in given and world not in worlds:
            raise UsageError(f"--{name} is for --world {' or '.join(worlds)}. Leave it out, or change that.")
    return SimulateConfig(
        world=world,
        robot_radius=settings.robot_radius,
        spacing=settings.spacing,
        laser=settings.laser() if laser else None,
        sonar=SonarPhysics(max_range=settings.sonar_max_range) if sonar else None,
        **given,
    )


def refuse_absent_sensor(sources: Mapping[str, str], laser: bool, sonar: bool) -> None:
    """Raise UsageError for a setting of a sensor that the robot does not have; `sources`: keys to what has set them.

    What a file of settings has may be for other robots.
    """
    for name, source in sources.items():
        if not source.startswith("--"):
            continue
        key = name.removeprefix("simulate.")
        if (key in LASER and not laser) or (key == "sonar_max_range" and not sonar):
            without = "there is --no-laser" if key in LASER else "there is no --sonar"
            raise UsageError(f"{source}: {without}. Leave it out, or change that.")


@dataclasses.dataclass(frozen=True, eq=False)
class Simulation:
    """The result of a simulation."""

    config: SimulateConfig
    seed: int
    world: World
    n_redrawn: int  # draws from the prior that left too little space
    scans: Scans  # poses of the robot, which are those of its laser too
    laser: Floats | None  # (n_scans, n_beams) metres; inf: no return
    sonar: Floats | None  # (n_scans, 16) metres; inf: no return
    given: Scans  # as the logs have them: `scans`, or others with errors

    @property
    def is_exact(self) -> bool:
        """Whether the logs have the true poses."""
        return self.given is self.scans


def simulate(config: SimulateConfig, seed: int, report: Callable[[float], None] = lambda done: None) -> Simulation:
    """Simulate a robot in a world.

    World, laser, sonar and poses of the logs have random numbers of their own: a change of one leaves all else as it
    was.

    `report`: called with the share of laser scans done.
    """
    for_world, for_poses, for_laser, for_sonar = spawn_generators(seed, 4)
    given = None if config.path is None else read_path(config.path)
    world, n_redrawn = _make_world(config, given, for_world)
    scans = _drive(config, world, given)
    laser = sonar = None
    if config.laser is not None:
        laser = simulate_laser(world.walls, scans.pose, config.laser, for_laser, report)
    if config.sonar is not None:
        sonar = simulate_sonar(world.walls, scans.pose, config.sonar, for_sonar)
    errors = (config.pose_noise, config.odometry_noise)
    recorded = scans if errors == (None, None) else given_scans(scans, *errors, for_poses)
    return Simulation(config, seed, world, n_redrawn, scans, laser, sonar, recorded)


def _make_world(config: SimulateConfig, given: PathFile | None, rng: np.random.Generator) -> tuple[World, int]:
    """Return the world, and how many draws were thrown away."""
    if config.world == OFFICE:
        return office(*config.size, rng), 0
    if config.world != ARAK:
        return read_world(config.world), 0
    window = Window.checked(0.0, 0.0, *config.size)
    return draw_world(config.scale, window, rng, lambda world: _can_be_driven(config, world, given))


def _can_be_driven(config: SimulateConfig, world: World, given: PathFile | None) -> bool:
    """Return whether a draw has room for a drive, or is free along the path that is given."""
    try:
        if given is not None:
            given.check(world)
            return True
        return roadmap(world, config.robot_radius).area >= MIN_ROOM * world.window.area
    except InputError:
        return False


def _drive(config: SimulateConfig, world: World, given: PathFile | None) -> Scans:
    """Return the scans of the drive that is given or planned."""
    n_scans = None if config.readings is None else -(-config.readings // config.readings_per_scan)
    if given is not None:
        given.check(world)
    if given is not None and given.has_headings:
        scans = given.scans()
        return _with_space(config, world, Scans(scans.pose[:n_scans], scans.time[:n_scans]))
    corners = given.rows if given is not None else plan_drive(roadmap(world, config.robot_radius), REACH)
    spacing = (config.spacing or SPACING[0], SPACING[1])
    return _with_space(config, world, scans_along(corners, spacing, n_scans))


def _with_space(config: SimulateConfig, world: World, scans: Scans) -> Scans:
    """Return scans after a look whether the sonar ring has space at all: a path that is given may pass too close."""
    if config.sonar is None:
        return scans
    places = np.concatenate([mounted(pose, PIONEER)[:, :2] for pose in scans.pose])
    free = world.free_at(places).reshape(-1, len(PIONEER)).all(axis=1)
    if not free.all():
        x, y = scans.pose[int(np.argmin(free)), :2]
        raise InputError(
            f"{config.path}: at ({x:g}, {y:g}) the sonar ring is in a wall or outside the world. Keep "
            f"{RING_RADIUS:.3g} m away."
        )
    return scans
