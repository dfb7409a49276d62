"""Compiled code and plain Python give the same answer: both tools, each from a process without compilation."""

from __future__ import annotations

import numpy as np
import pytest

from tests.same.child import classified, in_child, short_chain


def test_a_chain_is_the_same_to_the_last_bit():
    assert in_child("short_chain(600)", NUMBA_DISABLE_JIT="1") == short_chain(600)


def test_steps_that_differ_are_seen():
    assert short_chain(600)["accepted"] > 30
    assert short_chain(600) != short_chain(601)


@pytest.mark.slow
def test_a_small_map_has_the_same_patches_and_labels(tmp_path):
    plain = in_child(f"classified(Path({str(tmp_path)!r}))", NUMBA_DISABLE_JIT="1")
    (tmp_path / "result.ply").unlink()
    (tmp_path / "result.json").unlink()
    compiled = classified(tmp_path)
    assert plain["n_patches"] >= 10
    assert {"plausible", "suspicious"} <= set(plain["label"])
    for name in ("patch", "label"):
        assert plain[name] == compiled[name]
    np.testing.assert_allclose(plain["measures"], compiled["measures"], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(plain["p"], compiled["p"], rtol=0, atol=1e-6)
