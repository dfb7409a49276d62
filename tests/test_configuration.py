"""The settings of `prf`: they reach the models, and manifests keep them."""

from __future__ import annotations

import numpy as np
import pytest

from prf.configuration import IN_MANIFEST, Configuration, flat_name
from prf.model.sensors import LaserModel, PointModel, SonarModel
from prf.shell.cli.settings import load_options
from prf.shell.errors import ArgumentError, UsageError
from prf.simulate import SimulateConfig, config_of
from prf.simulate.sensors import SonarPhysics


def test_the_values_reach_the_models() -> None:
    laser = LaserModel(9.0, 0.05, 0.02, 0.1, 0.03)
    sonar = SonarModel(3.0, 0.04, 0.03, 1.5, 0.6, 2.0, 0.4, 12.0, 5.0, 0.3, 0.1, 0.7)
    values = {f"sonar_{name}": value for name, value in sonar}
    found = Configuration.of(**dict(laser), **values, points_sigma=2.0)
    assert (found.laser, found.sonar, found.points) == (laser, sonar, PointModel(sigma=2.0))


def test_manifests_keep_it_under_flat_names() -> None:
    made = Configuration.of(
        window=np.arange(4.0), sonar_cone=0.5, chains=np.int64(2), driven_radius=0.2, temperatures="auto"
    )
    flat = made.flat()
    assert (flat["window"], flat["sonar_cone"], flat["chains"]) == ((0.0, 1.0, 2.0, 3.0), 0.5, 2)
    assert Configuration.of(**flat) == made
    assert flat_name("sonar.noise") == "sonar_noise"
    assert Configuration.flag("driven.radius") == "--driven-radius"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"chains": 0}, "chains = 0"),
        ({"temperatures": 0}, "temperatures = 0: must be from 1"),
        ({"start": "moon"}, "start"),
        ({"driven_poses": "some"}, "driven_poses"),
        ({"temperatures": 2, "tiles": 4}, "tiles: tempered chains"),
        ({"nose": 1}, "nose: unknown setting"),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, object], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        Configuration.of(**values)


def test_options_of_a_verb_are_found_by_name() -> None:
    options = {"noise": 0.1, "scale": None, "resolution": 0.5, "assignments": ["points.sigma=2"], "json": True}
    found = load_options(Configuration, options, IN_MANIFEST)
    assert (found.settings.laser.noise, found.settings.sampler.resolution, found.settings.points.sigma) == (0.1, 0.5, 2)
    assert found.sources["sampler.resolution"] == "--resolution"
    with pytest.raises(UsageError, match=r"^--set points\.sigma: not read here\. Set a key of grid\."):
        load_options(Configuration, options, ("grid",))
    assert load_options(Configuration, {"resolution": 0.5}, ("grid",)).settings.grid.resolution == 0.5


def test_the_defaults_of_a_simulation_are_those_of_its_sensors() -> None:
    found = config_of(Configuration().simulate, "office", laser=True, sonar=True, size=None)
    assert found == SimulateConfig(sonar=SonarPhysics())
