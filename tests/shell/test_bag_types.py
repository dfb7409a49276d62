"""Types that a bag brings with it, against those of ROS."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from prf.shell.bag_types import refuse_other_types
from prf.shell.errors import InputError

USUAL = get_typestore(Stores.ROS2_HUMBLE)
SCAN = "sensor_msgs/msg/LaserScan"
STAMPED = "geometry_msgs/msg/TransformStamped"
HEADER = "std_msgs/Header header\n"


def judge(name: str, **definitions: str) -> None:
    """Look at type `name` in a bag that has the given types, by their names with two underlines for slashes."""
    store = get_typestore(Stores.EMPTY)
    for each, text in definitions.items():
        store.register(get_types_from_msg(text, each.replace("__", "/")))
    refuse_other_types(store, USUAL, name, "a.mcap")


@pytest.mark.parametrize("name", [SCAN, STAMPED, "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/PointCloud2"])
@pytest.mark.parametrize("store", [Stores.ROS1_NOETIC, Stores.ROS2_FOXY, Stores.LATEST])
def test_types_of_every_release_of_ros_are_taken(name: str, store: Stores) -> None:
    refuse_other_types(get_typestore(store), USUAL, name, "a.bag")


def test_other_widths_and_other_fields_are_taken() -> None:
    judge(SCAN, sensor_msgs__msg__LaserScan="float64 angle_min\nfloat64[] ranges\nstring maker\n")
    judge("my_msgs/msg/Own", my_msgs__msg__Own="string header\n")
    judge("no_msgs/msg/None")


@pytest.mark.parametrize(
    ("name", "definitions", "words"),
    [
        (SCAN, {"sensor_msgs__msg__LaserScan": "string angle_min\n"}, "angle_min of its sensor_msgs/LaserScan"),
        (SCAN, {"sensor_msgs__msg__LaserScan": "float32 ranges\n"}, "ranges of its sensor_msgs/LaserScan"),
        (SCAN, {"sensor_msgs__msg__LaserScan": "string[] ranges\n"}, "ranges of its sensor_msgs/LaserScan"),
        (SCAN, {"sensor_msgs__msg__LaserScan": "float32 header\n"}, "header of its sensor_msgs/LaserScan"),
        (STAMPED, {"geometry_msgs__msg__TransformStamped": "int32 child_frame_id\n"}, "child_frame_id of its geometry"),
        (
            STAMPED,
            {
                "geometry_msgs__msg__TransformStamped": HEADER,
                "std_msgs__msg__Header": "float32 frame_id\n",
            },
            "frame_id of its std_msgs/Header",
        ),
        (
            "tf/msg/tfMessage",
            {"tf__msg__tfMessage": "float32[] transforms\n"},
            "transforms of its tf/tfMessage",
        ),
    ],
)
def test_fields_that_hold_something_else_are_refused(name: str, definitions: dict[str, str], words: str) -> None:
    with pytest.raises(InputError, match=rf"^a\.mcap: the field {words}.* holds something else than that of ROS"):
        judge(name, **definitions)
