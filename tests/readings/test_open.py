"""Which readings of which log are taken."""

from __future__ import annotations

import gzip
import io
from pathlib import Path

import pytest

from prf.readings import NoReadings, read_logs, read_readings
from prf.sampler.session import default_output
from prf.shell.errors import ConfigError, InputError
from tests.readings.bags import START, Maker, Note, drive
from tests.readings.samples import flaser, player_laser, position, save

CARMEN = flaser([1, 2, 3])
SONAR = "SONAR 2 1.5 2.5 1 2 0.5 1 2 0.5 3.5 host 3.5\nPARAM robot_sonar_offsets 0.1 0 0.5 0.1 0 -0.5 nohost 0\n"
PLAYER = "## Player version 2.1.2\n" + position(1, 2, 0, 1) + player_laser([1, 2], 1)
TABLE = "x,y,theta,range\n1,2,0.5,3\n"


def refusal(path: str) -> str:
    with pytest.raises(InputError) as caught:
        read_readings(path)
    return str(caught.value)


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize(
    ("content", "n_beams", "name"), [(CARMEN, 3, "CARMEN"), (TABLE, 1, "table"), (PLAYER, 2, "Player")]
)
@pytest.mark.parametrize("file_name", ["a.log", "a.csv", "a.gz", "a"])
def test_the_content_decides_not_the_name(tmp_path, content, n_beams, name, zipped, file_name):
    readings = read_readings(save(tmp_path, content, file_name, zipped))
    assert (readings.n_beams, readings.notes.format) == (n_beams, name)
    assert readings.source.endswith(file_name)


@pytest.mark.parametrize("zipped", [False, True])
def test_standard_input(monkeypatch, zipped):
    data = gzip.compress(CARMEN.encode()) if zipped else CARMEN.encode()
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(data)))
    readings = read_readings("-")
    assert (readings.n_beams, readings.source) == (3, "standard input")


def test_a_long_preamble_before_the_first_laser_line(tmp_path):
    assert read_readings(save(tmp_path, "PARAM a b nohost 0\n" * 5000 + CARMEN)).n_beams == 3
    assert read_readings(save(tmp_path, "STRANGE 1\n" * 500 + CARMEN)).n_beams == 3


def test_a_byte_order_mark(tmp_path):
    assert read_readings(save(tmp_path, b"\xef\xbb\xbf" + TABLE.encode())).n_beams == 1


def test_a_table_of_sonar(tmp_path):
    assert read_readings(save(tmp_path, TABLE), "sonar", cone=0.2).cone.tolist() == [0.2]
    with pytest.raises(NoReadings, match="without SONAR lines"):
        read_readings(save(tmp_path, CARMEN), "sonar")


def test_any_kind(tmp_path):
    assert read_readings(save(tmp_path, CARMEN + SONAR), None).notes.devices == ("FLASER",)
    assert read_readings(save(tmp_path, SONAR), None).notes.devices == ("SONAR",)
    with pytest.raises(NoReadings, match="FLASER"):
        read_readings(save(tmp_path, "PARAM a b nohost 0\n"), None)
    with pytest.raises(NoReadings, match="FLASER"):
        read_readings(save(tmp_path, SONAR), "laser")


def test_topic_and_frame_where_there_are_none(tmp_path):
    for options in ({"topic": "/scan"}, {"frame": "map"}):
        with pytest.raises(ConfigError, match="is a table"):
            read_readings(save(tmp_path, TABLE), **options)
    with pytest.raises(ConfigError, match=r"--topic RLASER: .* has FLASER"):
        read_readings(save(tmp_path, CARMEN), topic="RLASER")
    both = CARMEN + flaser([4, 5], kind="RLASER")
    assert read_readings(save(tmp_path, both), topic="RLASER").range.tolist() == [4, 5]
    for kind in ("laser", None):
        with pytest.raises(ConfigError, match="--frame ODOM: laser lines of"):
            read_readings(save(tmp_path, CARMEN + SONAR), kind, frame="ODOM")
    with pytest.raises(ConfigError, match="--topic left: the sonar readings of"):
        read_readings(save(tmp_path, CARMEN + SONAR), "sonar", topic="left")
    assert read_readings(save(tmp_path, CARMEN + SONAR), "sonar", topic="SONAR").n_beams > 0


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b" \n\n", "the file is empty"),
        (b"#ROSRECORD V1.2\n", "a version before 1.3"),
        (b"Odometry -2.4 4.8 2.59 \nLaser 2 0.6 0.6\n", "unlocalized"),
        (bytes(range(256)), "binary data"),
        (gzip.compress(b"x", mtime=0), "gzipped twice"),
        (b'{"a": 1}', "JSON"),
        (b"ply\nformat ascii 1.0\n", "a 3D point cloud (PLY), which mapq takes"),
        (b"1,2,3,4\n", "without a header"),
        (b"x;y;theta;range\n1;2;3;4\n", "not separated by commas"),
        (b"7 7\n766\n1 0 3.3798 31 0 2 12 1\n", "text of an unknown format"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path, content, words):
    message = refusal(save(tmp_path, content, zipped=content[:2] == b"\x1f\x8b"))
    assert words in message
    assert "Accepted are CARMEN logs" in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"#ROSBAG V2.0\n\x45\0", "the bag is damaged"),
        (b"## Player version 2.1.2 \n## File version 0.3.0 \n", "Player log without laser readings"),
        (b"1106955333.287 rossum 6665 laser 00 1106955333.276 16 +00.115\n", "ends too early"),
    ],
)
def test_what_is_recognised_but_empty_or_damaged(tmp_path, content, words):
    message = refusal(save(tmp_path, content))
    assert words in message
    assert "\n" not in message


def test_missing_file_and_folder(tmp_path):
    assert "no such file" in refusal(str(tmp_path / "none.log"))
    assert "folder" in refusal(str(tmp_path))


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Two lasers and two sonars."""
    make = Maker("ros1")
    notes = drive(make)
    notes += [Note(topic, START + 1, make.scan(START + 1, [1, 2, 3])) for topic in ("/front", "/rear")]
    notes += [Note(topic, START + 1, make.range(START + 1, 1.0, "laser")) for topic in ("/left", "/right")]
    return str(make.write(tmp_path_factory.mktemp("bag") / "two.bag", notes))


def test_topics_and_frame_are_for_their_logs(bag: str) -> None:
    laser, sonar = read_logs([bag], [bag], topic="/rear", sonar_topic="/left", frame="odom")
    assert laser is not None
    assert sonar is not None
    assert (laser.notes.devices, sonar.notes.devices) == (("/rear",), ("/left",))
    assert laser.origin[:, 1].max() < 1.0, "in the frame map it is beyond y = 20"
    assert sonar.origin[:, 1].max() < 1.0
    with pytest.raises(ConfigError, match="--topic"):
        read_logs([bag], [])


def test_the_frame_is_for_the_sonar_of_a_carmen_log(tmp_path: Path) -> None:
    log = tmp_path / "both.log"
    sonar = "SONAR 0.5 1 2.0 0 0 0 5.0 pippo 5.0\n"
    poses = "".join(f"ODOM {x} 0 0 0 0 0 {4 + x} pippo 5.0\n" for x in range(3))
    log.write_text(flaser([1, 2], pose=(7, 8, 0)) + poses + sonar)
    found = read_logs([str(log)], [str(log)], frame="ODOM")
    assert [None if each is None else each.origin[0].tolist() for each in found] == [[7, 8], [1, 0]]
    with pytest.raises(ConfigError, match="carry the laser's pose"):
        read_logs([str(log)], [], frame="ODOM")


def test_the_cone_is_for_sonars_without_one(tmp_path: Path) -> None:
    table = tmp_path / "ring.csv"
    table.write_text("x,y,theta,range\n5,5,0,1\n")
    laser, sonar = read_logs([], [str(table)], cone=0.2)
    assert laser is None
    assert sonar is not None
    assert sonar.cone.tolist() == [0.2]


def test_a_topic_without_its_log_is_refused(bag: str) -> None:
    with pytest.raises(ConfigError, match="sonar_topic"):
        read_logs([], [bag], topic="/left")
    with pytest.raises(ConfigError, match="--sonar, which is not given"):
        read_logs([bag], [], topic="/rear", sonar_topic="/left")


@pytest.mark.parametrize(
    ("log", "stem"),
    [
        ("logs/intel.log.gz", "intel"),
        ("drive.bag", "drive"),
        ("drive.BAG.gz", "drive"),
        ("a/drive.mcap", "drive"),
        ("drive/", "drive"),
        ("drive.db3", "drive"),
        ("2021-03-02.17.csv", "2021-03-02.17"),
        ("office.v2", "office.v2"),
        (".csv", ".csv"),
        ("-", "laser"),
    ],
)
def test_an_output_is_named_after_the_log(log: str, stem: str) -> None:
    assert default_output(log) == Path(f"{stem}.run")
