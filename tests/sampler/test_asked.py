"""Options over a settings file over defaults, and what a configuration comes to in a settings file."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from prf.occupancy import GridConfig
from prf.sampler.asked import Asked, ask, field_of, settings_of
from prf.sampler.config import SampleConfig, laser_model, sonar_model
from prf.sensors.laser import LaserModel
from prf.sensors.sonar import SonarModel
from prf.settings_file import TABLES, read_settings, write_settings
from prf.shell.errors import ConfigError


@pytest.fixture
def site(tmp_path: Path) -> Path:
    (tmp_path / "site.toml").write_text(
        "[prior]\nscale = 0.2\n[laser]\nnoise = 0.05\nmax_range = 9\n[sonar]\nnoise = 0.06\ncone = 0.4\n"
    )
    return tmp_path / "site.toml"


def test_options_win_over_the_file(site: Path) -> None:
    asked = ask({"scale": 0.5, "window": None, "chains": 2}, site)
    assert asked.values == {
        "scale": 0.5, "chains": 2, "noise": 0.05, "max_range": 9.0, "sonar_noise": 0.06, "sonar_cone": 0.4
    }  # fmt: skip
    assert asked.places["scale"] == "--scale"
    assert asked.places["sonar_noise"] == f"{site}: [sonar] noise"
    assert ask({"sonar_max_range": 2.0}) == Asked({"sonar_max_range": 2.0}, {"sonar_max_range": "--sonar-max-range"})


def test_what_a_configuration_does_not_know_is_passed_over(site: Path) -> None:
    assert ask({}, site, ("max_range", "sonar_cone")).values == {"max_range": 9.0, "sonar_cone": 0.4}


def test_every_key_of_a_settings_file_is_a_field_and_reaches_the_models(tmp_path: Path) -> None:
    """No parameter can be added to a model without a way to set it."""
    changed = {
        "laser": LaserModel(9.0, 0.05, 0.02, 0.1, 0.03),
        "sonar": SonarModel(3.0, 0.04, 0.03, 1.5, 0.6, 2.0, 0.4, 12.0, 5.0, 0.3, 0.1, 0.7),
    }
    tables = {table: dataclasses.asdict(model) for table, model in changed.items()}
    for table, values in tables.items():
        default = dataclasses.asdict(SampleConfig())
        assert all(value != default[field_of(table, key)] for key, value in values.items()), "the test changes each"
    tables["sonar"]["cone"] = 0.5
    tables["prior"] = {"scale": 0.3, "window": (0.0, 0.0, 5.0, 6.0)}
    assert {table: set(values) for table, values in tables.items()} == {
        table: set(content.keys) for table, content in TABLES.items() if table in tables
    }
    write_settings(tmp_path / "all.toml", tables)
    config = SampleConfig(**ask({}, tmp_path / "all.toml").values)
    assert laser_model(config) == changed["laser"]
    assert sonar_model(config) == changed["sonar"]
    assert (config.scale, config.window, config.sonar_cone) == (0.3, (0.0, 0.0, 5.0, 6.0), 0.5)
    assert {table: settings_of(config)[table] for table in tables} == tables


def test_the_defaults_are_a_settings_file(tmp_path: Path) -> None:
    write_settings(tmp_path / "default.toml", settings_of(SampleConfig()))
    assert SampleConfig(**ask({}, tmp_path / "default.toml").values) == SampleConfig()
    assert "window" not in read_settings(tmp_path / "default.toml")["prior"]


def test_a_grid_shares_the_defaults() -> None:
    grid, sample = GridConfig(), SampleConfig()
    for name in ("window", "max_range", "sonar_max_range", "sonar_cone"):
        assert getattr(grid, name) == getattr(sample, name)


def test_a_bad_file_is_the_users_error(site: Path) -> None:
    site.write_text("[laser]\nnoise = 0\n")
    with pytest.raises(ConfigError, match=r"site\.toml:2: \[laser\] noise"):
        ask({}, site)


@pytest.mark.parametrize("changes", [{"chains": 0}, {"chains": 10**20}, {"rungs": 0}, {"rungs": 10**20}])
def test_numbers_of_chains_that_no_machine_holds_are_refused(changes: dict[str, int]) -> None:
    (name,) = changes
    with pytest.raises(ConfigError, match=rf"--{name} \d+: must be from 1 to"):
        SampleConfig(**changes)
