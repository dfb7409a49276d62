"""Same seed, same bytes, whatever the number of threads."""

from __future__ import annotations

import json

import pytest

from tests.same.child import ROOT, call, sampled

WAYS = {
    "plain": "--chains 3 --steps 20000",
    "tiles": "--chains 2 --steps 40000 --tiles 4",
    "tempered": "--chains 2 --steps 10000 --rungs 3",
    "prior": "--chains 2 --steps 10000 --start prior",
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
