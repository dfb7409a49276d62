from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mapq.io import write_ply
from mapq.posed import PosedScans, check_poses, merge_scans, read_edges, write_without
from mapq.posed.breaks import Breaks, breaks_of
from mapq.posed.check_poses import CheckedPoses
from mapq.posed.check_scans import PRIOR, PlacedScans, check_scans, log_odds_wrong, pairs_of, scene_of
from mapq.posed.edges import EdgeError
from mapq.posed.register import Alignment, motion_about, moved_by, register, surface_of
from mapq.posed.solve import RIGHT, SADDLE, Relation, solve
from prf.shell.errors import InputError
from tests.cli.mapq_samples import call
from tests.mapq.factories import Rectangle
from tests.mapq.perturb.scenes import COURT, look, make_scans, pose_at

NICHE = Rectangle((13.0, 3.0, 1.0), (1, 1, 0), width=3.0, height=2.0)
WAY = [pose_at(3.0 + 1.5 * k, 6.0, 8.0 * k) for k in range(9)]
SCANS = make_scans([look([*COURT, NICHE], pose, k, 12.0) for k, pose in enumerate(WAY)], WAY)
SHIFT = np.array([0.25, -0.3, 0.0])


def with_shift(scan: int) -> PosedScans:
    poses = SCANS.poses.copy()
    poses[scan, :3, 3] += SHIFT
    return SCANS.with_poses(poses, "displaced")


def relation(one: int, other: int, motion: np.ndarray, places: np.ndarray) -> Relation:
    return Relation(
        one, other, Alignment(motion, places[one], np.diag(np.repeat([0.02, 0.002], 3) ** -2.0), 1.0, 500.0)
    )


def test_a_motion_is_found_with_information_in_the_directions_that_walls_show() -> None:
    points = look([*COURT, NICHE], WAY[0], 1, 12.0)
    motion = motion_about(np.array([10.0, 7.0, 0.0]), np.array([0.3, -0.4, 0.05, 0.0, 0.0, 0.03]))
    a, b = (
        surface_of(points, np.array([5.0, 6.0, 1.5])),
        surface_of(moved_by(motion, points), np.array([5.2, 5.7, 1.5])),
    )
    fit = register(a, b, np.eye(4))
    assert fit is not None
    assert fit.share > 0.95
    np.testing.assert_allclose(moved_by(fit.motion, points), moved_by(motion, points), atol=0.01)
    wall = surface_of(look([COURT[0], COURT[4]], WAY[0], 1, 30.0), None)
    along = register(wall, wall, np.eye(4))
    assert along is not None
    errors = np.sqrt(np.diag(np.linalg.inv(along.information))[:3])
    assert errors[0] > 0.3, "nothing shows where a wall is along itself"
    assert errors[1:].max() < 0.05


def test_scans_without_a_common_surface_have_no_motion() -> None:
    near = surface_of(look(COURT, WAY[0], 1, 12.0), None)
    far = surface_of(look(COURT, WAY[0], 2, 12.0) + 100.0, None)
    assert register(near, far, np.eye(4)) is None


@pytest.mark.parametrize("scan", [0, 4])
def test_a_displaced_scan_is_first_and_gets_its_motion(scan: int) -> None:
    moved = with_shift(scan)
    rows = check_poses(merge_scans(moved), moved).scans
    assert (rows[0].scan, rows[0].file) == (scan, f"scan {scan}")
    np.testing.assert_allclose([rows[0].dx, rows[0].dy, rows[0].dz], -SHIFT, atol=0.03)
    assert rows[0].low <= np.linalg.norm(SHIFT) <= rows[0].high
    assert rows[0].p_wrong > 0.99
    assert max(row.p_wrong for row in rows[1:]) < 0.1
    assert sorted(row.scan for row in rows) == list(range(9))


def test_right_scans_are_right_and_a_single_one_has_nothing_to_differ_from() -> None:
    shares: list[float] = []
    checked = check_poses(merge_scans(SCANS), SCANS, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert max(row.p_wrong for row in checked.scans) < 0.1
    assert (checked.drift, checked.edges) == (None, ())
    alone = SCANS.every(100)
    (row,) = check_poses(merge_scans(alone), alone).scans
    assert row.p_wrong == pytest.approx(PRIOR, abs=1e-3)


def test_motion_that_grows_is_a_drift() -> None:
    poses = SCANS.poses.copy()
    way = 1.5 * np.arange(9)
    poses[:, 1, 3] += 0.04 * way
    drifting = SCANS.with_poses(poses, "drift")
    drift = check_poses(merge_scans(drifting), drifting).drift
    assert drift is not None
    assert drift.unit == "m/m"
    assert drift.low <= 0.04 <= drift.high
    poses = SCANS.poses.copy()
    poses[5:, 1, 3] += 0.4
    jump = SCANS.with_poses(poses, "jump")
    assert check_poses(merge_scans(jump), jump).drift is None


def test_weights_are_those_of_an_independent_solution() -> None:
    """A twin without sparse matrices: shifts alone, all weights from their definition."""
    rng = np.random.default_rng(2)
    places = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    truth = np.zeros((6, 3))
    truth[3] = 0.5, 0.1, 0.0
    pairs = [(a, b) for a in range(6) for b in range(a + 1, 6)]
    apart = [truth[a] - truth[b] + 0.01 * rng.standard_normal(3) for a, b in pairs]
    apart[0] = apart[0] + 3.0
    relations = [
        relation(a, b, motion_about(places[a], np.array([*d, 0, 0, 0])), places)
        for (a, b), d in zip(pairs, apart, strict=True)
    ]
    found = solve(relations, places)
    x = found.motion[:, :3, 3].copy()
    np.testing.assert_allclose(x, truth, atol=0.02)
    for _ in range(50):
        left, right = np.zeros((6, 6)), np.zeros((6, 3))
        for (a, b), d in zip(pairs, apart, strict=True):
            c = ((x[a] - x[b] - d) ** 2).sum() / 0.02**2
            weight = (SADDLE / (SADDLE + c)) ** 2 / 0.02**2
            left[a, a] += weight
            left[b, b] += weight
            left[a, b] -= weight
            left[b, a] -= weight
            right[a] += weight * d
            right[b] -= weight * d
        for k in range(6):
            left[k, k] += (SADDLE / (SADDLE + (x[k] ** 2).sum() / RIGHT[0] ** 2)) ** 2 / RIGHT[0] ** 2
        x = np.linalg.solve(left, right)
    np.testing.assert_allclose(found.motion[:, :3, 3], x, atol=0.005)


def test_odds_grow_with_the_motion_and_are_the_prior_without_information() -> None:
    sharp, wide = np.diag(np.repeat([0.02, 0.002], 3) ** -2.0), np.repeat([0.5, 0.05], 3)
    shifts = np.array([0.0, 0.05, 0.1, 0.3, 1.0])
    odds = [log_odds_wrong(sharp, sharp @ np.array([x, 0, 0, 0, 0, 0]), RIGHT, wide) for x in shifts]
    assert all(a < b for a, b in pairwise(odds))
    assert odds[0] < -4.0 < 4.0 < odds[3]
    nothing = log_odds_wrong(np.zeros((6, 6)), np.zeros(6), RIGHT, wide)
    assert nothing == pytest.approx(np.log(PRIOR / (1.0 - PRIOR)))


def test_pairs_are_neighbours_and_what_overlaps_most() -> None:
    pairs = pairs_of(scene_of(merge_scans(SCANS), SCANS.poses))
    assert {(k, k + 1) for k in range(8)} <= set(pairs)
    assert all(a < b for a, b in pairs)


@pytest.mark.parametrize("bare", [[3], [0, 3], [0, 1, 2, 3]])
def test_a_scan_without_planes_is_in_no_pair(bare: list[int]) -> None:
    wall = np.stack(np.meshgrid(np.arange(0.0, 6.0, 0.1), [0.0], np.arange(0.0, 3.0, 0.1)), axis=-1).reshape(-1, 3)
    surfaces = tuple(surface_of(wall[:0] if scan in bare else wall, None) for scan in range(4))
    pairs = pairs_of(PlacedScans(surfaces, np.zeros((4, 3))))
    seeing = [scan for scan in range(4) if scan not in bare]
    assert pairs == [(one, other) for one in seeing for other in seeing if one < other]


def twisted(shifts: np.ndarray, edges: tuple[EdgeError, ...] = ()) -> Breaks:
    """Return the breaks of motions that shift scans along y."""
    motion = np.tile(np.eye(4), (len(shifts), 1, 1))
    motion[:, 1, 3] = shifts
    places = np.column_stack([np.arange(float(len(shifts))), np.zeros((len(shifts), 2))])
    return breaks_of(CheckedPoses(edges=edges, motion=motion, places=places))


def test_motions_are_parted_into_single_scans_jumps_and_drift() -> None:
    at, y = np.array([4.0, 5.0, 0.0]), np.array([0.0, 1.0, 0.0])
    lone, jump = (np.where(some, 0.4, 0.0) for some in (np.arange(12) == 5, np.arange(12) > 5))
    for shifts, (one, other), expected in (
        (lone, (2, 5), (0.0, -0.4, 0.0, 0.0)),
        (jump, (2, 9), (0.0, 0.0, 0.4, 0.0)),
        (jump, (7, 9), (0.0, 0.0, 0.0, 0.0)),
        (0.04 * np.arange(12.0), (2, 9), (0.0, 0.0, 0.0, 0.28)),
    ):
        parts = twisted(shifts).split(one, other, at, y)
        assert (*parts.alone, parts.jump, parts.drift) == pytest.approx(expected, abs=1e-9)


def test_a_wrong_edge_bends_what_loops_over_it_span() -> None:
    rows = [((3, 4), 0.9), ((2, 7), 0.1), ((6, 9), 0.1), ((10, 11), 0.1)]
    edges = tuple(EdgeError(ends, 0.0, 0.0, p, row, ends) for row, (ends, p) in enumerate(rows))
    found = twisted(np.zeros(12), edges)
    assert [(edge.ids, edge.span) for edge in found.edges] == [((3, 4), (2, 9))]
    assert found.edge_over(8, 11) == found.edges[0]
    assert found.edge_over(9, 11) is None


# Graphs.


def edge_line(one: int, other: int, motion: np.ndarray) -> str:
    values = (*motion[:3, 3], *Rotation.from_matrix(motion[:3, :3]).as_quat())
    return f"EDGE_SE3:QUAT {one} {other} " + " ".join(f"{x:.9f}" for x in values) + " 1 0 0 0 0 0" + " 0" * 15 + "\r\n"


def write_graph(path: Path, poses: np.ndarray, spoiled: tuple[int, int] | None = None) -> list[tuple[int, int]]:
    """Write a graph of a chain and of three loops, with an edge to a vertex without a scan, and odd bytes."""
    pairs = [*((k, k + 1) for k in range(8)), (0, 5), (2, 7), (1, 8), (8, 77)]
    text = "# made by hand\r\n"
    for k, pose in enumerate(poses):
        values = (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat())
        text += f"VERTEX_SE3:QUAT {k} " + " ".join(f"{x:.9f}" for x in values) + "\r\n"
    for one, other in pairs:
        motion = np.eye(4) if other == 77 else np.linalg.inv(SCANS.poses[one]) @ SCANS.poses[other]
        if (one, other) == spoiled:
            motion = motion_about(np.zeros(3), np.array([0.4, 0.3, 0.0, 0.0, 0.0, 0.02])) @ motion
        text += edge_line(one, other, motion)
    path.write_bytes(text.encode() + b"FIX 0\n# \xe9 without an end")
    return pairs


@pytest.mark.parametrize("spoiled", [(2, 7), (3, 4)])
def test_a_wrong_edge_is_named_where_its_error_is_spread(spoiled: tuple[int, int], tmp_path: Path) -> None:
    spread = SCANS.poses.copy()
    spread[:, 0, 3] += 0.03 * np.arange(9)
    path, target = tmp_path / "graph.g2o", tmp_path / "new.g2o"
    pairs = write_graph(path, spread, spoiled)
    scans = SCANS.with_poses(spread, str(path))
    edges = read_edges(scans)
    assert [edge.ids for edge in edges] == pairs
    shares: list[float] = []
    checked = check_poses(merge_scans(scans), scans, edges, shares.append)
    assert shares == sorted(shares)
    assert {0.5, 1.0} < set(shares)
    assert checked.edges[0].ids == spoiled
    assert checked.edges[0].error_m == pytest.approx(0.5, abs=0.2)
    assert checked.edges[0].error_rad == pytest.approx(0.02, abs=0.01)
    assert [edge.p_wrong > 0.5 for edge in checked.edges] == [True] + [False] * (len(pairs) - 1)
    unknown = next(edge for edge in checked.edges if edge.ids == (8, 77))
    assert (unknown.error_m, unknown.error_rad, unknown.p_wrong) == (None, None, PRIOR)
    write_without(str(path), str(target), checked.wrong_rows)
    rows = path.read_bytes().splitlines(keepends=True)
    assert target.read_bytes() == b"".join(row for k, row in enumerate(rows) if k != checked.edges[0].row)


def test_ends_that_share_no_surface_cannot_be_checked() -> None:
    poses = [pose_at(4.0, 6.0), pose_at(104.0, 6.0)]
    far = [Rectangle((m[0] + 100.0, *m[1:]), w.across, w.along, w.width, w.height) for w in COURT if (m := w.middle)]
    scans = make_scans([look(COURT, poses[0], 0, 12.0), look(far, poses[1], 1, 12.0)], poses)
    checked = check_scans(merge_scans(scans), scans)
    assert all(row.p_wrong == pytest.approx(PRIOR, abs=1e-3) for row in checked.rows)


def test_edges_have_the_numbers_of_the_scans_that_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    write_graph(path, SCANS.poses)
    scans = SCANS.with_poses(SCANS.poses, str(path))
    assert [edge.scans for edge in read_edges(scans, 2)][-4:] == [(0, -1), (1, -1), (-1, 4), (4, -1)]
    path.write_text("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0.5\nEDGE_SE2 0 1 1 0.25 0.5 1 0 0 1 0 1\n")
    (edge,) = read_edges(SCANS.every(5).with_poses(SCANS.poses[:2], str(path)))
    np.testing.assert_allclose(edge.motion[:2, 3], [1.0, 0.25])
    np.testing.assert_allclose(Rotation.from_matrix(edge.motion[:3, :3]).as_rotvec(), [0.0, 0.0, 0.5])


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("EDGE_SE3:QUAT 0 1 1 2 3", "graph.g2o:1: not an edge of two vertices and a pose of 7 numbers"),
        ("EDGE_SE2 0 x 1 2 3 1 0 0 1 0 1", "graph.g2o:1: not an edge of two vertices and a pose of 3 numbers"),
        ("EDGE_SE2 0 1 nan 2 3 1 0 0 1 0 1", "graph.g2o:1: not an edge"),
        ("EDGE_SE3:QUAT 0 1 1 2 3 0 0 0 2", "graph.g2o:1: the quaternion of this edge has length 2, not 1"),
    ],
)
def test_edges_that_are_none_are_refused_in_one_line(row: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "graph.g2o").write_text(row + "\n")
    with pytest.raises(InputError, match=words):
        read_edges(SCANS.with_poses(SCANS.poses, str(tmp_path / "graph.g2o")))


def test_the_command_lists_them_and_writes_the_graph(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scans").mkdir()
    for k in range(9):
        write_ply(str(tmp_path / "scans" / f"{k}.ply"), SCANS.read(k))
    write_graph(tmp_path / "graph.g2o", SCANS.poses, (1, 8))
    command = "classify scans --poses graph.g2o --graph-out new.g2o -o out.ply"
    code, out, err = call(capsys, *command.split(), "-v")
    assert code == 0, err
    assert "scans           0 of 9 probably displaced" in out
    assert "edges           1 of 12 probably wrong" in out
    assert "from 8 to 77 cannot be checked" in out
    answer = json.loads((tmp_path / "out.json").read_text())
    assert [len(answer[name]) for name in ("scans", "edges")] == [9, 12]
    assert {"scan", "file", "dx", "dy", "dz", "yaw", "low", "high", "p_wrong", "blamed_m2"} == answer["scans"][0].keys()
    assert {"from", "to", "error_m", "error_rad", "p_wrong"} == answer["edges"][0].keys()
    assert (answer["edges"][0]["from"], answer["edges"][0]["to"]) == (1, 8)
    assert (tmp_path / "new.g2o").read_bytes().count(b"EDGE") == 11
    assert call(capsys, "report", "out.ply", "-o", "out.html")[0] == 0
    page = (tmp_path / "out.html").read_text()
    assert "Scans and edges, worst first" in page
    assert "Probably wrong scans: none of 9. Probably wrong edges: <strong>from 1 to 8</strong>, of 12." in page
    assert page.count('<tr class="wrong"><td>▲ 1 to 8</td>') == 1
    code, _, err = call(capsys, *command.split())
    assert (code, len(err.splitlines())) == (4, 1)
    (tmp_path / "poses.txt").write_text("\n".join(" ".join(map(str, p[:3].ravel())) for p in SCANS.poses))
    others = "--poses", "poses.txt", "--graph-out", "other.g2o", "-o", "other.ply"
    code, _, err = call(capsys, "classify", "scans", *others)
    assert code == 2
    assert "has no edges of g2o. Leave out --graph-out" in err
    assert call(capsys, "classify", "scans/0.ply", "--graph-out", "other.g2o")[0] == 2
