"""Posed scans: clouds in the frame of their sensor, and where the sensor was when it took each of them."""

from mapq.posed.check_poses import check_poses as check_poses
from mapq.posed.find import find_scans as find_scans
from mapq.posed.find import replace_poses as replace_poses
from mapq.posed.graph import read_edges as read_edges
from mapq.posed.graph import write_without as write_without
from mapq.posed.merge import merge_scans as merge_scans
from mapq.posed.scans import PosedScans as PosedScans
from mapq.posed.scans import drive_passes as drive_passes
