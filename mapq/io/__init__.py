"""Reading and writing clouds, patches, results and models."""

from mapq.io.clouds import read_cloud as read_cloud
from mapq.io.patches import is_patches as is_patches
from mapq.io.patches import read_patches as read_patches
from mapq.io.patches import write_patches as write_patches
from mapq.io.ply import write_ply as write_ply
from mapq.io.write import write_cloud as write_cloud
