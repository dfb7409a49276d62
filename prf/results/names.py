"""Files of a RUN directory, and the version of each that this program writes and reads."""

from __future__ import annotations

MANIFEST = "manifest.json"
DRAWS = "draws.npz"
POSTERIOR = "posterior.npz"
READINGS = "readings.npz"
POSES = "poses.npz"
MAP = "map.geojson"
DIAGNOSTICS = "diagnostics.json"
CHECKPOINT = "checkpoint.npz"
PICTURE = "posterior.png"
TRAJECTORY = "trajectory.csv"

TRAJECTORY_HEADER = "scan,t,x,y,theta,sd_x,sd_y,sd_theta,cov_xy,cov_xt,cov_yt"

SCHEMAS = {
    MANIFEST: "prf.run/1",
    DRAWS: "prf.draws/1",
    POSTERIOR: "prf.posterior/2",
    READINGS: "prf.readings/1",
    POSES: "prf.poses/1",
    MAP: "prf.map/1",
    DIAGNOSTICS: "prf.diagnostics/1",
}
OLD_POSTERIOR = "prf.posterior/1"
"""Without the cells that were seen; read, no longer written."""
PLAN_SCHEMA = "prf.plan/1"
"""Centre lines and doors, which an export writes."""
CHECKPOINT_SCHEMA = "prf.checkpoint/3"
"""Apart from the others: only the sampler writes and reads what is in it."""
SONAR_PREFIX = "sonar_"
"""Arrays of readings.npz with this prefix hold the sonar readings."""
WAY = "way"
"""Array of readings.npz with the way driven; runs of earlier releases have none."""
COUNT_PREFIX = "beams_"
"""Arrays of readings.npz with this prefix hold the counts of beams; runs of earlier releases have none."""
POINT_PREFIX = "point_"
"""Arrays of readings.npz with this prefix hold the point observations."""
LOOP_PREFIX, BODY_PREFIX = "loop_", "body_"
"""Arrays of poses.npz with these prefixes hold loops in dispute, and the pose of readings that were let go of."""
WALLS, WALL_OFFSETS = "wall", "wall_offsets"
"""Arrays of draws.npz with the walls of maps of walls, and where those of each draw begin."""
FUNCTIONAL_PREFIX = "functional_"
"""Arrays of draws.npz with this prefix hold one functional each."""
