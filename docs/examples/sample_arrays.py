"""From arrays: a laser looks round a room of 6 x 4 m from four poses, and two places are known besides."""

import numpy as np

import prf

low, high = np.array([0.0, 0.0]), np.array([6.0, 4.0])  # corners of the room
pose = np.array([[1.0, 1.0, 0.0], [5.0, 1.0, 2.0], [5.0, 3.0, 3.0], [1.0, 3.0, -1.0]])  # x, y, heading
angle = np.radians(np.arange(0.5, 360.0, 4.0))  # of each beam on the sensor

theta = pose[:, 2, None] + angle
direction = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
to_wall = (np.where(direction > 0.0, high, low) - pose[:, None, :2]) / direction
ranges = to_wall.min(axis=-1) + np.random.default_rng(1).normal(0.0, 0.02, theta.shape)

run = prf.sample(
    [
        prf.laser(pose, angle, ranges),
        prf.points([[3.0, 2.0], [-0.3, 2.0]], [0, 1]),  # 1 is occupied
    ],
    prf.Prior(scale=0.2, window=(-0.5, -0.5, 6.5, 4.5)),
    [prf.LaserModel(max_range=8.0, noise=0.03), prf.PointModel(kind="binary", flip_probability=0.05)],
    steps=10_000,
    chains=2,
    seed=1,
    output="room",
)
print(run.query([[3.0, 2.0], [-0.1, 2.0]]))

longer = prf.resume("room", steps=20_000)  # as if it had never stopped
again = prf.read_run("room")
print(len(run.draws), len(longer.draws), len(again.draws))
