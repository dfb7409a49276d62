"""Poses of a file for the scans of a log: matching, mounting, and clocks that do not agree."""

from __future__ import annotations

import numpy as np
import pytest

from prf.readings import read_poses, read_readings
from prf.shell.errors import ConfigError, InputError
from tests.readings.bags import START, Maker, Note, drive, scans
from tests.readings.samples import flaser, player, player_laser, position, save

WAY = [(1.0, 2.0, 0.5), (2.0, 2.0, 1.0), (2.0, 4.0, 3.0), (0.0, 4.0, -3.0)]
"""Poses at 0, 1, 2 and 3 s; from the third to the last the shorter turn leads over pi."""


def csv(tmp_path, way=WAY, times=(0, 1, 2, 3), name="way.csv"):
    return save(
        tmp_path,
        "t,x,y,theta\n" + "".join(f"{t!r},{x},{y},{a}\n" for t, (x, y, a) in zip(times, way, strict=True)),
        name,
    )


def log(tmp_path, times, offset=0.0):
    """Write FLASER lines of two beams with poses that are no good; the laser sits `offset` ahead on the robot."""
    return save(tmp_path, "".join(flaser([1, 2], (9 + offset, 9, 0), (9, 9, 0), t) for t in times))


def scans_of(path, file, **how):
    readings = read_readings(
        path,
        topic=how.pop("topic", None),
        frame=how.pop("frame", None),
        poses=read_poses(file, **{"gap": 2.0, **how}),
    )
    return readings, readings.notes.scans.pose


def test_poses_are_interpolated_and_scans_outside_are_dropped_and_counted(tmp_path):
    readings, pose = scans_of(log(tmp_path, (-1, 0, 0.5, 2.5, 3.005, 9)), csv(tmp_path))
    np.testing.assert_allclose(pose[:, :2], [[1, 2], [1.5, 2], [1, 4], [0, 4]], atol=1e-12)
    np.testing.assert_allclose(np.cos(pose[:, 2]), np.cos([0.5, 0.75, np.pi, -3]), atol=1e-12)
    assert readings.notes.scans.number.tolist() == [1, 2, 3, 4]
    assert sorted(set(readings.scan)) == [1, 2, 3, 4]
    assert "2 of 6 scans have no pose and are dropped: 2 outside the time of" in readings.notes.warnings[0]
    np.testing.assert_allclose(readings.angle[:2], 0.5 + np.array([-np.pi / 2, np.pi / 2]))


def test_a_gap_between_poses_is_not_crossed(tmp_path):
    path, way = log(tmp_path, (0, 1, 5, 8.99)), csv(tmp_path, times=(0, 1, 9, 10))
    readings, pose = scans_of(path, way)
    assert pose[:, 0].tolist() == [1.0, 2.0, pytest.approx(2.0)], "that at 8.99 has the pose of 9"
    assert "1 between poses more than readings.pose_gap = 2 s apart" in readings.notes.warnings[0]
    assert len(scans_of(path, way, gap=8.0)[1]) == 4


@pytest.mark.parametrize(("offset", "x"), [(0.0, 1.0), (0.3, 1.0 + 0.3 * np.cos(0.5))])
def test_the_place_of_the_laser_on_the_robot_is_that_of_its_lines_or_as_given(tmp_path, offset, x):
    path, way = log(tmp_path, (0, 1), offset), csv(tmp_path)
    readings, pose = scans_of(path, way)
    assert pose[0, 0] == pytest.approx(x)
    assert ("FLASER sits at x 0.3 y 0 theta 0 on it" in readings.notes.poses) == (offset > 0)
    for mount in ((0.0, 0.0, 0.0), (0.0, 0.2, np.pi)):
        moved, pose = scans_of(path, way, mount=mount)
        np.testing.assert_allclose(pose[0], [1 - mount[1] * np.sin(0.5), 2 + mount[1] * np.cos(0.5), 0.5 - mount[2]])
        turn = np.exp(1j * (moved.angle - readings.angle - mount[2]))
        np.testing.assert_allclose(turn, 1.0)
        np.testing.assert_allclose(moved.origin[:2], [pose[0, :2]] * 2)


def test_the_offset_of_raw_carmen_lines_is_that_of_param(tmp_path):
    raw = "RAWLASER1 0 -0.5 1.0 0.5 20 0.01 0 3 1 2 3 0 {0} host {0}\n"
    text = "PARAM robot_frontlaser_offset 0.1 nohost 0\nPARAM robot_frontlaser_side_offset 0.2 nohost 0\n"
    _, pose = scans_of(save(tmp_path, text + raw.format(0) + raw.format(1)), csv(tmp_path, [(5, 5, 0)] * 4))
    np.testing.assert_allclose(pose[0], [5.1, 5.2, 0.0])
    with pytest.raises(InputError, match=r"2 RAWLASER1.*give their trajectory with --poses"):
        read_readings(save(tmp_path, raw.format(0) + raw.format(1)))


def test_the_geometry_of_player_places_the_laser_and_its_positions_do_not_count(tmp_path):
    geometry = player("laser", (0.1, 0.0, 0.0, 0.14, 0.14), kind="004 001")
    lines = geometry + "".join(position(7, 7, 7, t) + player_laser([1, 2], t) for t in (0.0, 1.0))
    _, pose = scans_of(save(tmp_path, lines), csv(tmp_path, [(5, 5, 0)] * 4))
    np.testing.assert_allclose(pose, [[5.1, 5, 0]] * 2)


def test_scans_without_times_are_matched_by_order(tmp_path):
    dp_slam = "".join(f"Odometry 0 0 0\nLaser 3 1 2 {3 + k}\n" for k in range(2))
    g2o = "VERTEX_SE2 12 2 4 3\nVERTEX_SE2 3 1 2 0.5\nEDGE_SE2 3 12 0 0 0 1 0 0 1 0 1\n"
    readings, pose = scans_of(save(tmp_path, dp_slam), save(tmp_path, g2o, "a.g2o"))
    np.testing.assert_allclose(pose[:, :2], [[1, 2], [2, 4]], err_msg="in the order of the numbers of vertices")
    assert "matched by order" in readings.notes.poses
    with pytest.raises(
        InputError, match=r"the scans of .* have no times; nor by order: .* has 2 scans, .*way.csv 4 poses"
    ):
        scans_of(save(tmp_path, dp_slam), csv(tmp_path))


def test_a_table_on_the_robot(tmp_path):
    table = "t,theta,range\n" + "".join(f"{t},{a},1\n" for t in (0, 1) for a in (-0.5, 0.5))
    readings, pose = scans_of(save(tmp_path, table), csv(tmp_path))
    np.testing.assert_allclose(readings.angle, [0.0, 1.0, 0.5, 1.5], atol=1e-12)
    np.testing.assert_allclose(pose[1], [2, 2, 1])
    for columns, words in (
        ("t,x,y,theta,range\n0,1,2,0,1\n1,2,2,0,1\n", "x changes. Leave columns x and y out"),
        ("theta,range\n0,1\n", "Add a column t"),
    ):
        with pytest.raises(InputError, match=words):
            scans_of(save(tmp_path, columns), csv(tmp_path))


class TestClocks:
    @pytest.mark.parametrize(
        ("times", "words"),
        [
            ([1.7e9 + k for k in range(4)], r"they hardly overlap.*--set readings.pose_offset=-1699999999.500"),
            ([k * 10**9 for k in range(4)], r"at most 2 s apart: give seconds of one clock"),
            ([-9, -8, 9, 10], r"at most 2 s apart.*readings.pose_gap="),
            ([0.5, -100, 100, 200], r"hardly any scan"),
        ],
    )
    def test_clocks_that_share_nothing(self, tmp_path, times, words):
        with pytest.raises(InputError, match=words):
            scans_of(log(tmp_path, (0.5, 1.5, 2.5)), csv(tmp_path, times=times))

    def test_as_many_poses_as_scans_go_by_order_with_a_warning(self, tmp_path):
        path, way = log(tmp_path, (0, 1, 2, 3)), csv(tmp_path, times=[1.7e9 + k for k in range(4)])
        readings, pose = scans_of(path, way)
        np.testing.assert_allclose(pose[:, 0], [1, 2, 2, 0])
        assert "as many poses as scans: matched by order" in readings.notes.warnings[0]
        assert not scans_of(path, way, offset=-1.7e9)[0].notes.warnings

    def test_a_clock_too_coarse_to_match_by(self, tmp_path):
        with pytest.raises(InputError, match=r"too coarse to match by; nor by order: .* has 3 scans, .* 4 poses"):
            scans_of(log(tmp_path, ("1.01893e+09",) * 3), csv(tmp_path))


@pytest.mark.parametrize("row", ["1 0 0 {0} 0 0 1 0 0 -1 0 0\n", "1 0 0 0 0 1 0 0 0 0 1 {0}.5\n"])
def test_poses_of_a_camera_are_refused(tmp_path, row):
    camera = "".join(row.format(2 * k) for k in range(2))
    with pytest.raises(InputError, match=r"lie on their side or climb .* as those of a camera"):
        scans_of(log(tmp_path, (0, 1)), save(tmp_path, camera, "poses.txt"))


class TestBag:
    def test_poses_are_of_the_robot_that_tf_hangs_the_sensor_on(self, tmp_path):
        make = Maker("ros1")
        notes = [note for note in drive(make) if note.topic == "/tf_static"] + scans(make, 0, 1, 2)
        path = str(make.write(tmp_path / "a.bag", notes))
        way = csv(tmp_path, [(5, 5, 0)] * 4, [START + t for t in range(4)])
        readings, pose = scans_of(path, way)
        np.testing.assert_allclose(pose, [[5.2, 5, 0]] * 3, atol=1e-12)
        assert "as those of base_link; /scan sits at x 0.2 y 0 theta 0" in readings.notes.poses
        np.testing.assert_allclose(scans_of(path, way, frame="laser")[1], [[5, 5, 0]] * 3, atol=1e-12)
        with pytest.raises(ConfigError, match=r"--frame map: .* must be fixed to the sensor; .* has laser, base_link"):
            scans_of(path, way, frame="map")
        with pytest.raises(InputError, match=r"no transforms lead from the fixed frame 'map'.*'base_link'.*--poses"):
            read_readings(path)

    def test_a_pose_topic_of_a_localizer_is_the_robots(self, tmp_path):
        make = Maker("mcap")
        notes = [note for note in drive(make) if note.topic == "/tf_static"] + scans(make, 0, 1, 2)
        for k, topic in enumerate(("/amcl_pose", "/goal_pose")):
            notes += [Note(topic, START + t, make.pose(START + t, (t + 9 * k, 5, 0), "map")) for t in (0, 1, 2)]
        readings = read_readings(str(make.write(tmp_path / "bag", notes)))
        np.testing.assert_allclose(readings.notes.scans.pose[:, 0], [0.2, 1.2, 2.2], atol=1e-12)
        assert "poses are those of '/amcl_pose'" in readings.notes.warnings[0]
        assert "drifts" not in readings.notes.warnings[0]
