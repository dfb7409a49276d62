"""Which readings of which log are taken."""

from __future__ import annotations

from pathlib import Path

import pytest

from prf.logs import read_logs
from prf.sampler.output import default_output
from prf.shell.errors import ConfigError
from tests.logs.bags import START, Maker, Note, drive
from tests.logs.samples import flaser


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Two lasers and two sonars."""
    make = Maker("ros1")
    notes = drive(make)
    notes += [Note(topic, START + 1, make.scan(START + 1, [1, 2, 3])) for topic in ("/front", "/rear")]
    notes += [Note(topic, START + 1, make.range(START + 1, 1.0, "laser")) for topic in ("/left", "/right")]
    return str(make.write(tmp_path_factory.mktemp("bag") / "two.bag", notes))


def test_topics_and_frame_go_to_their_logs(bag: str) -> None:
    laser, sonar = read_logs(bag, bag, topic="/rear", sonar_topic="/left", frame="odom")
    assert laser is not None
    assert sonar is not None
    assert (laser.notes.devices, sonar.notes.devices) == (("/rear",), ("/left",))
    assert laser.origin[:, 1].max() < 1.0, "in the frame map it is beyond y = 20"
    assert sonar.origin[:, 1].max() < 1.0
    with pytest.raises(ConfigError, match="--topic"):
        read_logs(bag, None)


def test_the_frame_is_for_the_sonar_of_a_carmen_log(tmp_path: Path) -> None:
    log = tmp_path / "both.log"
    sonar = "SONAR 0.5 1 2.0 0 0 0 5.0 pippo 5.0\n"
    poses = "".join(f"ODOM {x} 0 0 0 0 0 {4 + x} pippo 5.0\n" for x in range(3))
    log.write_text(flaser([1, 2], pose=(7, 8, 0)) + poses + sonar)
    found = read_logs(str(log), str(log), frame="ODOM")
    assert [None if each is None else each.origin[0].tolist() for each in found] == [[7, 8], [1, 0]]
    with pytest.raises(ConfigError, match="carry the laser's pose"):
        read_logs(str(log), None, frame="ODOM")


def test_the_cone_is_for_sonars_without_one(tmp_path: Path) -> None:
    table = tmp_path / "ring.csv"
    table.write_text("x,y,theta,range\n5,5,0,1\n")
    laser, sonar = read_logs(None, str(table), cone=0.2)
    assert laser is None
    assert sonar is not None
    assert sonar.cone.tolist() == [0.2]


def test_a_topic_without_its_log_is_refused(bag: str) -> None:
    with pytest.raises(ConfigError, match="sonar_topic"):
        read_logs(None, bag, topic="/left")
    with pytest.raises(ConfigError, match="--sonar, which is not given"):
        read_logs(bag, None, topic="/rear", sonar_topic="/left")


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
