"""Copies of the package with one deliberate mistake in a kernel, and checks of them in processes of their own."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
Replacement = tuple[str, str, str]


class Mutant(NamedTuple):
    """Mistake: (file, seen from ``prf/kernels/moves``, text that stands there exactly once, text in its place), ..."""

    name: str
    replacements: tuple[Replacement, ...]


SLIDE_END = """* (graph.vertex_xy[v, 1] - graph.vertex_xy[u, 1])
    if not placing.is_inside(graph.window, x, y):
        return ILLEGAL
    move_interior_to(graph, proposal, v, x, y)
    return True, 0.0, {}
"""
TRIANGLE_LOCAL = "u, v, w, 1.0, 1.0, 1.0) / surface"
NO_COUNTS = (
    ("recolor.py", "log_forward = math.log(1.0 /", "log_forward = 0.0 * math.log(1.0 /"),
    ("recolor.py", "return math.log(first +", "return 0.0 * math.log(first +"),
)

OTHER_EDGE = "link_density(graph, tuning, a, b, u, v, p, q)"
SECOND_FACE = "gap_density(graph, tuning, r, u, s, t, p, q, a, b)"

INTACT = Mutant("intact", ())
SLIDE = Mutant(
    "slide with the factor r / r'",
    (("move_vertex.py", SLIDE_END.format("0.0"), SLIDE_END.format("-math.log(stretch)")),),
)
NO_WAY_BACK = Mutant(
    "local recolour without counts and without the test of the reverse pair",
    (*NO_COUNTS, ("recolor.py", "return -math.inf", "return 0.0")),
)
COUNTS = Mutant("local recolour without counts", NO_COUNTS)
BIRTH = Mutant(
    "triangle birth without the number of its orders",
    (
        ("interior_triangle.py", "uniform = 6.0 /", "uniform = 1.0 /"),
        ("interior_triangle.py", TRIANGLE_LOCAL, "u, v, w, 0.5, 0.0, 0.0) / surface"),
    ),
)
MERGE = Mutant(
    "merge that ignores the changed number of edges",
    (("split_edge.py", "edges_after = graph.counts[c.EDGES] - 1", "edges_after = graph.counts[c.EDGES]"),),
)
LINK_COUNTS = Mutant(
    "links without the partner counts",
    (("nearby_edges.py", "return 1.0 / n if n > 0 else 0.0", "return 1.0 if n > 0 else 0.0"),),
)
MEND_EDGES = Mutant(
    "mend that ignores the changed length",
    (("cut_wall.py", "density / length_after(graph, proposal)", "density / graph.sums[c.TOTAL_LENGTH]"),),
)
ONE_FACE = Mutant(
    "cut that could have begun at one face alone",
    (
        ("cut_wall.py", "forward += gap_density(", "forward += 0.0 * gap_density("),
        ("cut_wall.py", f"density += {SECOND_FACE} / n", "density += 0.0"),
    ),
)
ONE_EDGE = Mutant(
    "join that could have begun at one edge alone",
    (("join_wall.py", f"density += {OTHER_EDGE} * links_now(graph, index, f, e)", "n += 0"),),
)
ONE_ORDER = Mutant(
    "docking that could be undone in one order alone",
    (("dock.py", "return True, log_forward, math.log(2.0 /", "return True, log_forward, math.log(1.0 /"),),
)
NOTCH_WALLS = Mutant(
    "tooth without the number of walls near its tip",
    (
        (
            "notch.py",
            "join_tooth(graph, targets, proposal, tuning, a, b) / n",
            "join_tooth(graph, targets, proposal, tuning, a, b)",
        ),
    ),
)
BEND_WALLS = Mutant(
    "bend without the number of edges near the return",
    (("split_edge.py", "target_of(targets, graph, v)) / n", "target_of(targets, graph, v))"),),
)
ONE_SIZE = Mutant(
    "births of three sizes that count the largest alone",
    (("interior_triangle.py", "median = placing.reach_of(tuning, size)", "median = placing.reach_of(tuning, 0)"),),
)
WHOLE_AREA = Mutant(
    "births in a tile that count the area of the whole window (10 x 10 m)",
    (("interior_triangle.py", "surface = placing.area(graph.window)", "surface = 100.0"),),
)
RARE_TURNS = Mutant(
    "exact draws that turn a twentieth too rarely",
    (
        (
            "../arak_sampler.py",
            "rng.standard_exponential() / (2.0 * size.p * crossing",
            "rng.standard_exponential() / (1.9 * size.p * crossing",
        ),
    ),
)
SINE_BORDER = Mutant(
    "exact draws that leave the left side with density |sin f| / 2 in place of cos(f) / 2",
    (
        (
            "../arak_sampler.py",
            "math.asin(2.0 * rng.random() - 1.0)",
            "math.copysign(math.acos(rng.random()), rng.random() - 0.5)",
        ),
    ),
)
NO_JACOBIAN = Mutant(
    "warp without its Jacobian", (("../poses/warp.py", "- change - log_vertices - log_poses", "- change"),)
)
NO_DENSITY = Mutant(
    "a match that leaves its densities out",
    (
        (
            "../poses/match.py",
            "return decide(chain, poses, i, i, log_ratio, rng)",
            "return decide(chain, poses, i, i, 0.0, rng)",
        ),
    ),
)
NO_NEIGHBOUR = Mutant(
    "moves of poses that forget the odometry's step to the next one",
    (("../poses/state.py", "min(high, at.shape[0] - 2) + 1", "min(high, at.shape[0] - 1)"),),
)


def altered_copy(folder: Path, mutant: Mutant) -> Path:
    """Copy the package into `folder` and make the mistake there; AssertionError where the text is not there once."""
    package = folder / "prf"
    shutil.copytree(ROOT / "prf", package, ignore=shutil.ignore_patterns("__pycache__"))
    for file, old, new in mutant.replacements:
        path = package / "kernels" / "moves" / file
        source = path.read_text()
        assert source.count(old) == 1, f"{mutant.name}: {file} has {source.count(old)} times {old!r}"
        path.write_text(source.replace(old, new))
    return package


def run_check(folder: Path, mutant: Mutant, module: str, *arguments: str, compiled: bool) -> Any:
    """Run ``python -m module arguments`` on an altered copy and return the JSON that it prints.

    Its compiled kernels get a cache in `folder`. The copy comes first on the path, the tests are the project's.
    """
    package = altered_copy(folder, mutant)
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]),
        "PYTHONDONTWRITEBYTECODE": "1",
        "PRF_CACHE_DIR": str(folder / "cache"),
        "NUMBA_DISABLE_JIT": "0" if compiled else "1",
    }
    command = [sys.executable, "-m", module, *arguments]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert Path(found["package"]).is_relative_to(package), "the check ran on another package"
    return found
