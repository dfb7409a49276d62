"""The same seed gives the same bytes for any number of threads, compiled and as plain Python."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.small_jobs import ROOT, call, classified, in_child, sampled, short_chain

WAYS = {
    "plain": "--chains 3 --steps 20000",
    "tiles": "--chains 2 --steps 40000 --set sampler.tiles=4",
    "tempered": "--chains 2 --steps 10000 --set sampler.temperatures=3",
    "prior": "--chains 2 --steps 10000 --set sampler.start=prior",
}


@pytest.mark.parametrize("way", [pytest.param(w, marks=[] if w == "plain" else pytest.mark.slow) for w in WAYS])
def test_a_run_is_the_same_for_any_number_of_threads(way, tmp_path):
    one = sampled(tmp_path / "one", f"{WAYS[way]} --threads 1")
    assert sampled(tmp_path / "three", f"{WAYS[way]} --threads 3") == one


def test_another_seed_gives_other_bytes(tmp_path):
    one = sampled(tmp_path / "one", "--chains 2 --steps 10000")
    other = sampled(tmp_path / "other", "--chains 2 --steps 10000 --seed 4")
    assert all(one[name] != other[name] for name in one)


def test_an_annealed_map_has_the_same_shape_for_any_number_of_threads(tmp_path):
    office = f"--laser {ROOT / 'data' / 'demo-office.log.gz'} --every-scan 40 --every-beam 20"
    found = []
    for threads in (1, 3):
        path = tmp_path / f"{threads}.geojson"
        call("prf", f"anneal {office} --steps 20000 --seed 3 --threads {threads} -o {path}")
        content = json.loads(path.read_text())
        found.append((content["geometry"], content["properties"]["score"]))
    assert found[0] == found[1]


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
