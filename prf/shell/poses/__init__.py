"""Files of poses, in the plane and in space: trajectories, tf and bags."""
