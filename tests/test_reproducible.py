"""The same seed gives the same bytes for any number of threads; the same map the same labels as plain Python."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mapq.io import read_cloud, write_ply
from tests.cli.calls import call
from tests.conftest import ROOT
from tests.mapq.labelled import draw_patches

OFFICE = f"--laser {ROOT / 'data' / 'demo-office.log.gz'} --every-scan 40 --every-beam 20"
WAYS = {
    "plain": "--chains 3 --steps 20000",
    "tiles": "--chains 2 --steps 40000 --set sampler.tiles=4",
    "tempered": "--chains 2 --steps 10000 --set sampler.temperatures=3",
    "prior": "--chains 2 --steps 10000 --set sampler.start=prior",
}
SAMPLED = ("draws.npz", "posterior.npz", "map.geojson")
"""Files of a RUN that depend on the seed and the input alone."""


def done(line: str, folder: Path) -> None:
    found = call(f"{line} -q", folder)
    assert found.code == 0, found.err


def sampled(folder: Path, options: str) -> dict[str, bytes]:
    """Return what ``prf sample`` gives for a few beams of the demo office."""
    done(f"prf sample {OFFICE} --resolution 1 {options} -o run -f", folder)
    return {name: (folder / "run" / name).read_bytes() for name in SAMPLED}


def classified(folder: Path) -> dict[str, Any]:
    """Return what ``mapq`` says of a small cloud: patches, labels, probabilities."""
    write_ply(str(folder / "walls.ply"), draw_patches(1, n_walls=12).cloud)
    done("mapq classify walls.ply --surfaces upright,level,tilted -o result.ply -f", folder)
    rows = json.loads((folder / "result.json").read_text())["patches"]
    return {
        "patch": hashlib.sha256(read_cloud(str(folder / "result.ply")).fields["patch"].tobytes()).hexdigest(),
        "label": [row["label"] for row in rows],
        "p": [row["p_suspicious"] for row in rows],
        "measures": [[row["area_m2"], row["rms_m"], row["difference"]] for row in rows],
    }


@pytest.mark.parametrize("way", [pytest.param(w, marks=[] if w == "plain" else pytest.mark.slow) for w in WAYS])
def test_a_run_is_the_same_for_any_number_of_threads(way: str, tmp_path: Path) -> None:
    one, three = (sampled(tmp_path, f"{WAYS[way]} --seed 3 --threads {threads}") for threads in (1, 3))
    assert one == three


def test_another_seed_gives_other_bytes(tmp_path: Path) -> None:
    one, other = (sampled(tmp_path, f"--chains 2 --steps 10000 --seed {seed}") for seed in (3, 4))
    assert all(one[name] != other[name] for name in one)


def test_an_annealed_map_has_the_same_shape_for_any_number_of_threads(tmp_path: Path) -> None:
    found = []
    for threads in (1, 3):
        done(f"prf anneal {OFFICE} --steps 20000 --seed 3 --threads {threads} -o best.geojson -f", tmp_path)
        content = json.loads((tmp_path / "best.geojson").read_text())
        found.append((content["geometry"], content["properties"]["score"]))
    assert found[0] == found[1]


@pytest.mark.slow
def test_a_small_map_has_the_same_patches_and_labels(tmp_path: Path) -> None:
    run = "print(json.dumps(classified(pathlib.Path(sys.argv[1]))))"
    code = f"import json, pathlib, sys; from tests.test_reproducible import classified; {run}"
    there = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"}
    child = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], env=there, capture_output=True, text=True, check=True
    )
    plain, compiled = json.loads(child.stdout.splitlines()[-1]), classified(tmp_path)
    assert len(plain["label"]) >= 10
    assert {"plausible", "suspicious"} <= set(plain["label"])
    for name in ("patch", "label"):
        assert plain[name] == compiled[name]
    np.testing.assert_allclose(plain["measures"], compiled["measures"], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(plain["p"], compiled["p"], rtol=0, atol=1e-6)
