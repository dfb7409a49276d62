"""ROS 1 and ROS 2 bags made here, with everything that real ones have done to their readers."""

from __future__ import annotations

import gzip
import io

import numpy as np
import pytest

from prf.readings import NoReadings, Readings, describe, read_readings
from prf.shell.errors import ConfigError, InputError, PrfError
from tests.readings.bags import KINDS, LEVEL, START, UPSIDE_DOWN, Maker, Note, drive, scans, yaw

NAN, INF = np.nan, np.inf


@pytest.fixture(params=KINDS)
def make(request) -> Maker:
    return Maker(request.param)


@pytest.fixture
def make1() -> Maker:
    return Maker("ros1")


def save(make: Maker, folder, notes: list[Note], name: str = "a.bag") -> str:
    return str(make.write(folder / name, notes))


def refusal(path: str, *args, **options) -> str:
    with pytest.raises(PrfError) as caught:
        read_readings(path, *args, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_pose_is_the_chain_from_map_to_laser_interpolated_in_time(make, tmp_path):
    readings = read_readings(save(make, tmp_path, drive(make) + scans(make, 0.5, 1.25)))
    assert readings.notes.format == ("ROS 1 bag" if make.kind == "ros1" else "ROS 2 bag")
    assert readings.notes.devices == ("/scan",)
    np.testing.assert_allclose(readings.notes.scans.pose, [[10, 20.7, np.pi / 2], [10, 21.45, np.pi / 2]], atol=1e-12)
    np.testing.assert_allclose(readings.origin[:3], [[10, 20.7]] * 3, atol=1e-12)
    np.testing.assert_allclose(readings.angle[:3], np.pi / 2 + np.array([-0.5, 0, 0.5]), atol=1e-7)
    np.testing.assert_array_equal(readings.range[:3], [1, 2, 3])
    np.testing.assert_allclose(readings.notes.scans.time, [START + 0.5, START + 1.25])
    assert not readings.cone.any()


def test_turns_are_interpolated_along_the_shorter_way(make1, tmp_path):
    notes = [
        Note("/tf", START + t, make1.tf(START + t, "map", "laser", (0, 0, 0), sign * np.array(yaw(angle))))
        for t, angle, sign in ((0, 3.0, 1), (1, 3.2, -1), (2, 3.4, 1))
    ]
    readings = read_readings(save(make1, tmp_path, notes + scans(make1, 0.5, 1.5)))
    heading = readings.notes.scans.pose[:, 2] % (2 * np.pi)
    np.testing.assert_allclose(heading, [3.1, 3.3], atol=1e-9)


def test_a_laser_upside_down_sweeps_the_other_way(make1, tmp_path):
    readings = read_readings(save(make1, tmp_path, drive(make1, UPSIDE_DOWN) + scans(make1, 1)))
    np.testing.assert_allclose(readings.angle, np.pi / 2 - np.array([-0.5, 0, 0.5]), atol=1e-7)
    assert readings.notes.remarks == ()


def test_a_tilted_laser_is_remarked_on(make1, tmp_path):
    tilted = (0.0, np.sin(0.1), 0.0, np.cos(0.1))
    readings = read_readings(save(make1, tmp_path, drive(make1, tilted) + scans(make1, 1)))
    assert "tilted by up to 11 degrees" in readings.notes.remarks[0]


def test_an_inverted_step_of_the_tree_is_walked_backward(make1, tmp_path):
    notes = [
        Note("/tf", START, make1.tf(START, "odom", "map", (-3, 0, 0), yaw(0.0))),
        Note("/tf", START, make1.tf(START, "odom", "laser", (1, 0, 0), LEVEL)),
    ]
    readings = read_readings(save(make1, tmp_path, notes + scans(make1, 0)))
    np.testing.assert_allclose(readings.origin[0], [4, 0], atol=1e-12)


def test_error_codes_are_dropped_and_no_return_is_inf(make, tmp_path):
    ranges = [0.007, 0.1, NAN, -INF, 7.9, 8.0, 65.5, INF, 0]
    notes = drive(make) + scans(make, 1, ranges=ranges, angle_increment=0.1)
    readings = read_readings(save(make, tmp_path, notes))
    np.testing.assert_allclose(readings.range, [0.1, 7.9, INF, INF, INF], rtol=1e-6)
    np.testing.assert_array_equal(readings.beam, [1, 4, 5, 6, 7])
    assert (readings.notes.n_invalid, readings.notes.n_zero_ranges) == (4, 0)
    summary = describe(readings, "a")
    assert summary.largest_range == 8.0
    assert summary.max_range == pytest.approx(0.97 * 8)
    assert "invalid-range" in {suspicion.code for suspicion in summary.suspicions}


def test_without_readings_at_the_sensors_maximum_the_largest_range_counts(make1, tmp_path):
    notes = drive(make1) + scans(make1, 1, ranges=[2, 5, INF])
    assert describe(read_readings(save(make1, tmp_path, notes)), "a").largest_range == 5


def test_a_scan_without_a_time_stamp_has_the_time_of_recording(make1, tmp_path):
    notes = [*drive(make1), Note("/scan", START + 1, make1.scan(0.0, [1, 2, 3]))]
    assert read_readings(save(make1, tmp_path, notes)).time[0] == START + 1


def test_scans_outside_the_time_of_the_transforms_are_dropped(make1, tmp_path):
    readings = read_readings(save(make1, tmp_path, drive(make1) + scans(make1, -5, 1, 2.4, 3)))
    np.testing.assert_allclose(readings.notes.scans.time, [START + 1, START + 2.4])
    np.testing.assert_allclose(readings.notes.scans.pose[1, :2], [10, 22.2], atol=1e-12)
    assert "2 of 4 scans" in readings.notes.remarks[0]
    (tmp_path / "b").mkdir()
    assert "within the time" in refusal(save(make1, tmp_path / "b", drive(make1) + scans(make1, 60)))


class TestTopics:
    def test_several_are_listed_and_one_is_chosen(self, make, tmp_path):
        notes = drive(make) + scans(make, 1) + scans(make, 1, topic="/rear", ranges=[5, 5])
        path = save(make, tmp_path, notes)
        message = refusal(path)
        assert "/rear, /scan" in message
        assert "--topic" in message
        for name in ("/rear", "rear"):
            readings = read_readings(path, topic=name)
            assert (readings.n_beams, readings.notes.devices) == (2, ("/rear",))
        assert readings.notes.lines["/scan"] == 1

    def test_what_is_not_there_is_refused_with_what_is(self, make1, tmp_path):
        path = save(make1, tmp_path, drive(make1) + scans(make1, 1))
        assert "--topic /other" in refusal(path, topic="/other")
        assert "/scan" in refusal(path, topic="/other")
        with pytest.raises(ConfigError, match="/scan"):
            read_readings(path, topic="/tf")
        with pytest.raises(NoReadings, match=r"/scan \(LaserScan\), /tf \(TFMessage\)"):
            read_readings(path, "sonar")


class TestFrames:
    @pytest.mark.parametrize(
        ("topic", "choice"),
        [("/ground_truth", "'/ground_truth'; --frame can choose odom"), ("/wheels", "'odom', odom")],
    )
    def test_without_map_the_best_frame_is_taken_with_a_warning(self, make, tmp_path, topic, choice):
        odometry = [Note(topic, START + t, make.odometry(START + t, (t, 5, 0))) for t in (0, 1, 2)]
        notes = [
            note
            for note in drive(make)
            if not (note.topic == "/tf" and note.body.transforms[0].header.frame_id == "/map")
        ]
        path = save(make, tmp_path, notes + odometry + scans(make, 1))
        unasked = read_readings(path)
        assert f"tf has no frame 'map': poses are those of {choice}" in unasked.notes.warnings[0]
        assert ("drifts" in unasked.notes.warnings[0]) == (topic == "/wheels")
        np.testing.assert_array_equal(
            unasked.origin, read_readings(path, frame="odom" if topic == "/wheels" else topic).origin
        )
        message = refusal(path, frame="map")
        for words in ("'map'", "'odom'", topic, "leave --frame out"):
            assert words in message
        np.testing.assert_allclose(read_readings(path, frame="odom").origin[0], [1.2, 0], atol=1e-12)
        np.testing.assert_allclose(read_readings(path, frame="/odom").origin[0], [1.2, 0], atol=1e-12)
        true = read_readings(path, frame=topic)
        np.testing.assert_allclose(true.origin[0], [1.2, 5], atol=1e-12)
        assert topic in true.notes.poses

    def test_odometry_that_names_its_child(self, make1, tmp_path):
        odometry = [
            Note("/truth", START + t, make1.odometry(START + t, (t, 5, 0), child="base_link")) for t in (0, 1, 2)
        ]
        path = save(make1, tmp_path, drive(make1) + odometry + scans(make1, 1))
        np.testing.assert_allclose(read_readings(path, frame="/truth").origin[0], [1.2, 5], atol=1e-12)

    def test_no_tf_at_all(self, make1, tmp_path):
        message = refusal(save(make1, tmp_path, scans(make1, 1)))
        assert "tf has no 'laser'" in message
        assert "Record /tf" in message

    @pytest.mark.filterwarnings("error")
    @pytest.mark.parametrize(
        ("shift", "turn"),
        [
            ((99, 99, 0), (0, 0, 0, 0)),
            ((NAN, 0, 0), (0, 0, 0, 1)),
        ],
    )
    def test_an_unsound_transform_is_passed_over(self, make1, tmp_path, shift, turn):
        bad = Note("/tf", START + 1, make1.tf(START + 1, "map", "odom", shift, turn))
        readings = read_readings(save(make1, tmp_path, [*drive(make1), bad, *scans(make1, 1)]))
        np.testing.assert_allclose(readings.origin[0], [10, 21.2], atol=1e-12)


class TestSonar:
    def ring(self, make: Maker, view: float = 0.3, radiation: int = 0) -> list[Note]:
        notes = drive(make)
        for i, angle in enumerate((0.5, -0.5)):
            frame = f"sonar{i}"
            notes.append(Note("/tf_static", START, make.tf(START, "base_link", frame, (0.1, 0, 0), yaw(angle))))
            for t, distance in ((0.5, 2.0), (1.0, 4.0), (1.5, 0.02)):
                body = make.range(START + t, distance + 0.1 * i * (distance == 2.0), frame, view, radiation)
                notes.append(Note(f"/sonar/{i}", START + t, body))
        return sorted(notes, key=lambda note: note.time)

    def test_every_range_topic_is_a_transducer(self, make, tmp_path):
        path = save(make, tmp_path, self.ring(make))
        readings = read_readings(path, "sonar")
        np.testing.assert_allclose(readings.range, [2, 2.1, INF, INF], rtol=1e-6)
        np.testing.assert_allclose(readings.angle[:2], np.pi / 2 + np.array([0.5, -0.5]), atol=1e-7)
        np.testing.assert_allclose(readings.origin[0], [10, 20.6], atol=1e-12)
        np.testing.assert_allclose(readings.cone, 0.3, rtol=1e-6)
        assert readings.notes.devices == ("/sonar/0", "/sonar/1")
        assert readings.notes.n_invalid == 2
        assert read_readings(path, "sonar", topic="/sonar/1").n_beams == 2
        assert read_readings(path, "sonar", topic="/sonar/1,/sonar/0").n_beams == 4
        assert read_readings(path, None).n_beams == 4
        with pytest.raises(NoReadings):
            read_readings(path)

    def test_without_a_view_the_cone_is_the_option(self, make1, tmp_path):
        path = save(make1, tmp_path, self.ring(make1, view=0.0))
        assert set(read_readings(path, "sonar").cone) == {0.349}
        assert set(read_readings(path, "sonar", cone=0.5).cone) == {0.5}

    def test_infrared_is_remarked_on(self, make1, tmp_path):
        remarks = read_readings(save(make1, tmp_path, self.ring(make1, radiation=1)), "sonar").notes.remarks
        assert "infrared" in remarks[0]


class TestFiles:
    @pytest.mark.parametrize("zipped", [False, True])
    def test_any_name_standard_input_and_gzip(self, make1, tmp_path, monkeypatch, zipped):
        path = make1.write(tmp_path / "a.bag", drive(make1) + scans(make1, 1))
        data = gzip.compress(path.read_bytes()) if zipped else path.read_bytes()
        renamed = tmp_path / "a.log"
        renamed.write_bytes(data)
        assert read_readings(str(renamed)).n_beams == 3
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))
        readings = read_readings("-")
        assert (readings.n_beams, readings.source) == (3, "standard input")

    @pytest.mark.parametrize(("kind", "suffix"), [("sqlite3", "db3"), ("mcap", "mcap")])
    def test_a_file_of_a_ros_2_bag_alone(self, tmp_path, kind, suffix):
        make = Maker(kind)
        folder = make.write(tmp_path / "bag", drive(make) + scans(make, 1))
        (file,) = folder.glob(f"*.{suffix}")
        assert read_readings(str(file)).n_beams == 3
        other = tmp_path / "renamed"
        other.write_bytes(file.read_bytes())
        assert read_readings(str(other)).n_beams == 3
        (folder / "metadata.yaml").unlink()
        assert read_readings(str(folder)).n_beams == 3
        file.unlink()
        assert "no bag file" in refusal(str(folder))

    @pytest.mark.parametrize("cut", [20, 400, 4000, -300])
    def test_a_damaged_bag_is_one_line(self, make, tmp_path, cut):
        path = make.write(tmp_path / "a", drive(make) + scans(make, 1))
        file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")
        file.write_bytes(file.read_bytes()[:cut])
        with pytest.raises(InputError) as caught:
            read_readings(str(path))
        assert "\n" not in str(caught.value)

    def test_a_scan_that_is_none_is_refused(self, make1, tmp_path):
        path = save(make1, tmp_path, drive(make1) + scans(make1, 1, angle_increment=0.0))
        assert "expected different directions" in refusal(path)

    def test_a_scan_of_one_beam_needs_no_step(self, make1, tmp_path):
        scan = make1.scan(START + 1, [2.0], angle_min=0.25, angle_increment=0.0)
        readings = read_readings(save(make1, tmp_path, [*drive(make1), Note("/scan", START + 1, scan)]))
        np.testing.assert_allclose(readings.angle, np.pi / 2 + 0.25)
        assert readings.range.tolist() == [2.0]

    def test_empty_scans_are_passed_over(self, make1, tmp_path):
        path = save(make1, tmp_path, drive(make1) + scans(make1, 0.5, ranges=[]) + scans(make1, 1))
        assert isinstance(read_readings(path), Readings)
        (tmp_path / "b").mkdir()
        assert "are empty" in refusal(save(make1, tmp_path / "b", drive(make1) + scans(make1, 1, ranges=[])))
