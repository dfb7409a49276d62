"""Which readings can be used, what is refused, and known maps in both formats."""

from __future__ import annotations

import dataclasses
import logging
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.calibrate import calibrate_laser, calibrate_sonar, fitted_text, read_known_map
from prf.calibrate.maps import read_ros_map
from prf.calibrate.settings import lines_of, report_of
from prf.configuration import Configuration
from prf.export.cells import Cells
from prf.export.images import pgm_bytes, png_bytes
from prf.export.ros_map import ros_map
from prf.logs import Readings
from prf.score import OccupiedArea
from prf.shell.errors import ConfigError, InputError
from prf.shell.settings import load
from prf.window import Window
from tests.calibrate.worlds import HALL, laser_log, sonar_log

WALL = shapely.box(6.0, 0.0, 7.0, 10.0)
AREA = OccupiedArea(WALL, HALL)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def ring_at(x: float, n: int = 40) -> Readings:
    angle = np.linspace(-0.3, 0.3, n)
    return Readings.from_arrays([[x, 5.0]] * n, angle, np.full(n, 2.0), cone=0.3, scan=np.arange(n) // 8)


class TestUsable:
    @pytest.mark.parametrize(("x", "words"), [(-3.0, "40 sensors stand outside"), (6.5, "40 in its walls")])
    def test_no_sensor_in_the_white_of_the_map(self, x: float, words: str) -> None:
        for calibrate in (calibrate_sonar, calibrate_laser):
            with pytest.raises(InputError, match=words):
                calibrate(ring_at(x), AREA, Configuration.of(max_range=8.0), rng())

    def test_some_are_dropped_counted_and_told(self, caplog: pytest.LogCaptureFixture) -> None:
        log = ring_at(4.0)
        origin = log.origin.copy()
        origin[:5, 0], origin[5:8, 0] = -3.0, 6.5
        with caplog.at_level(logging.WARNING):
            found = calibrate_sonar(dataclasses.replace(log, origin=origin), AREA, Configuration.of(), rng())
        assert (found.n_readings, found.n_outside, found.n_occupied) == (32, 5, 3)
        assert "5 of 40 readings dropped: their sensors stand outside the map" in caplog.text
        assert "3 of 40 readings dropped: their sensors stand in a wall" in caplog.text

    def test_no_wall_in_view(self) -> None:
        for calibrate in (calibrate_sonar, calibrate_laser):
            with pytest.raises(InputError, match="no wall of the map is in view"):
                calibrate(ring_at(1000.0), OccupiedArea(WALL, None), Configuration.of(max_range=8.0), rng())

    def test_a_map_in_another_frame_is_noticed(self, caplog: pytest.LogCaptureFixture) -> None:
        """A fifth of the readings has the wall in view, where by chance none of them tells of it."""
        known = laser_log(1, 12)
        turned = dataclasses.replace(known.readings, angle=known.readings.angle[::-1].copy())
        with caplog.at_level(logging.WARNING):
            calibrate_laser(known.readings, known.area, Configuration.of(max_range=8.0), rng())
            assert "no better than no map" not in caplog.text
            scrambled = dataclasses.replace(turned, range=np.random.default_rng(2).permutation(turned.range))
            calibrate_laser(scrambled, known.area, Configuration.of(max_range=8.0), rng())
        assert "no better than no map" in caplog.text

    def test_scans_are_thinned(self) -> None:
        known = sonar_log(2, 12)
        found = calibrate_sonar(known.readings, known.area, Configuration.of(scans="0::3"), rng())
        assert (found.n_scans, found.n_readings) == (4, 64)
        assert found.folds == 4

    def test_one_scan_is_held_out_by_readings(self) -> None:
        known = laser_log(3, 1)
        assert calibrate_laser(known.readings, known.area, Configuration.of(max_range=8.0), rng()).folds == 5

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({"sonar_max_range": 0.0}, "sonar-max-range"),
            ({"sonar_cone": 4.0}, "sonar-cone"),
        ],
    )
    def test_bad_options(self, options: dict, words: str) -> None:
        with pytest.raises(ConfigError, match=words):
            calibrate_sonar(ring_at(4.0), AREA, Configuration.of(**options), rng())

    def test_the_same_seed_deals_the_same_folds(self) -> None:
        known = laser_log(4, 10)
        one, two = (
            calibrate_laser(known.readings, known.area, Configuration.of(max_range=8.0), rng()) for _ in range(2)
        )
        assert one.held_out.tolist() == two.held_out.tolist()


class TestSettings:
    def test_what_is_written_is_read_back(self, tmp_path: Path) -> None:
        sonar, laser = sonar_log(5, 3), laser_log(5, 10)
        found = [
            calibrate_sonar(sonar.readings, sonar.area, Configuration.of(), rng()),
            calibrate_laser(laser.readings, laser.area, Configuration.of(max_range=8.0), rng()),
        ]
        (tmp_path / "robot.toml").write_text(fitted_text(found))
        again = load(Configuration, tmp_path / "robot.toml").settings
        assert again.sonar.cone == 0.4
        assert again.sonar.noise == pytest.approx(found[0].fit.value[0], rel=1e-4)
        assert again.laser.max_range == 8.0
        assert "hardly informed" in fitted_text(found)

    def test_report(self) -> None:
        known = laser_log(6, 10)
        found = calibrate_laser(known.readings, known.area, Configuration.of(max_range=8.0), rng())
        report = report_of(found)
        assert [row["name"] for row in report["parameters"]] == [*found.family.names]
        assert report["log_likelihood"] > report["log_likelihood_default"]
        assert math.isnan(report["cone"])
        lines = "\n".join(lines_of(found))
        assert "noise_relative" in lines
        assert "600 of 10 scans" in lines


def shades() -> np.ndarray:
    """12 x 20 cells of 0.5 m: a wall four cells wide from column 8 on, unknown on the right."""
    grey = np.full((12, 20), 254, np.uint8)
    grey[:, 8:12] = 0
    grey[:, 15:] = 205
    grey[:6, 10:12] = 254  # the upper half of the image, so of the map: two cells wide
    return grey


INLINE = (
    "image: map.pgm\nresolution: 0.5\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
BLOCK = (
    'image: "map.pgm"  # the image\nresolution: 5e-1\norigin:\n- -1\n- 2\n- 0\n'
    "negate: 0\noccupied_thresh: 0.65\nmode: trinary\n"
)


class TestRosMap:
    def write(self, folder: Path, yaml: str, grey: np.ndarray | None = None) -> Path:
        (folder / "map.pgm").write_bytes(pgm_bytes(shades() if grey is None else grey))
        (folder / "map.yaml").write_text(yaml)
        return folder / "map.yaml"

    @pytest.mark.parametrize("yaml", [INLINE, BLOCK], ids=["inline", "block"])
    def test_walls_lie_where_the_pixels_are(self, tmp_path: Path, yaml: str) -> None:
        area = read_known_map(self.write(tmp_path, yaml))
        assert area.window == Window(-1.0, 2.0, 9.0, 8.0)
        expected = shapely.union_all([shapely.box(3.0, 2.0, 5.0, 5.0), shapely.box(3.0, 5.0, 4.0, 8.0)])
        assert area.region.equals(expected)

    def test_negated_raw_png_and_turned(self, tmp_path: Path) -> None:
        plain = read_ros_map(self.write(tmp_path, INLINE)).region
        assert read_ros_map(
            self.write(tmp_path, INLINE.replace("negate: 0", "negate: 1"), 255 - shades())
        ).region.equals(plain)
        raw = np.where(shades() == 0, 100, np.where(shades() == 205, 255, 0)).astype(np.uint8)
        assert read_ros_map(self.write(tmp_path, INLINE + "mode: raw\n", raw)).region.equals(plain)
        (tmp_path / "map.png").write_bytes(png_bytes(shades(), np.ones(shades().shape, np.bool_)))
        assert read_ros_map(self.write(tmp_path, INLINE.replace(".pgm", ".png"))).region.equals(plain)
        turned = read_ros_map(self.write(tmp_path, INLINE.replace("0.0]", f"{math.pi / 2}]")))
        assert turned.window is None
        expected = shapely.affinity.rotate(plain, 90, origin=(-1.0, 2.0))
        assert turned.region.symmetric_difference(expected).area < 1e-9

    @pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
    def test_what_export_writes_has_walls_in_every_mode(self, tmp_path: Path, mode: str) -> None:
        """In mode scale the thresholds are 0 and 1, which no probability exceeds."""
        image = "map.png" if mode == "scale" else "map.pgm"
        made = ros_map(Cells((shades() == 0)[::-1].astype(float), np.array([-1.0, 2.0]), 0.5), mode, None, image)
        (tmp_path / "exported.yaml").write_text(made.yaml)
        plain = read_known_map(self.write(tmp_path, INLINE)).region
        (tmp_path / image).write_bytes(made.image)
        assert read_known_map(tmp_path / "exported.yaml").region.equals(plain)

    @pytest.mark.parametrize(
        ("yaml", "words"),
        [
            ("hello\n", "not the yaml file"),
            (INLINE.replace("0.65", "much"), "occupied_thresh is 'much'"),
            (INLINE.replace("0.5", "1e308"), "every bound must be finite"),
            (INLINE.replace("0.5", "-0.5"), "resolution"),
            (INLINE.replace("map.pgm", "none.pgm"), "none.pgm: no such file"),
            (INLINE.replace("map.pgm", "map.yaml"), "not an image"),
        ],
    )
    def test_damage(self, tmp_path: Path, yaml: str, words: str) -> None:
        with pytest.raises(InputError, match=words):
            read_known_map(self.write(tmp_path, yaml))

    def test_nothing_occupied(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="nothing is occupied"):
            read_known_map(self.write(tmp_path, INLINE, np.full((4, 4), 254, np.uint8)))
