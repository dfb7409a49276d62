from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from prf.shell.poses.tf import FrameTree


def test_a_mount_that_never_changes_holds_at_all_times() -> None:
    tree = FrameTree()
    turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    for time in (10.0, 11.0):
        tree.add("base", "laser", time, (SimpleNamespace(x=0.2, y=0.0, z=0.0), turn), is_static=False)
        tree.add("odom", "base", time, (SimpleNamespace(x=time, y=0.0, z=0.0), turn), is_static=False)
    times = np.array([0.0, 10.5, 99.0])
    mount, base = tree.poses("base", "laser", times), tree.poses("odom", "base", times)
    assert mount is not None
    assert base is not None
    assert mount.known.all()
    np.testing.assert_array_equal(mount.shift[:, 0], 0.2)
    assert base.known.tolist() == [False, True, False]
