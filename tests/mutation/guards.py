"""What keeps which source from mistakes: the quick tests that run on its altered copy, uncompiled."""

from __future__ import annotations

from typing import NamedTuple


class Guard(NamedTuple):
    """A source, and what has to fail when it is wrong.

    Attributes
    ----------
    module : str
    tests : tuple of str
        Arguments of pytest, quickest first; it stops at the first failure.
    moves : tuple of str
        Moves of the sampler whose ratios are checked besides (tests.mutation.ratios), before the tests.
    borders : bool
        Whether comparisons that differ at equality alone are altered: labels tie, coordinates do not.
    """

    module: str
    tests: tuple[str, ...]
    moves: tuple[str, ...] = ()
    borders: bool = False


CRF = "tests/mapq/crf"
DRAWS = "tests/kernels/test_proposal_draws.py::test_draws_have_the_density_of_the_reference"
"""That a move proposes what its ratio claims, by its name in brackets."""
DRAWN = {
    "triangle birth",
    "boundary birth",
    "corner birth",
    "split",
    "move interior",
    "move boundary",
    "past corner",
    "cut wall",
    "join wall",
    "dock",
    "notch",
    "lean",
    "stand",
}
"""Moves that draw where something comes to lie; the others choose among what is there."""
GROUPS: dict[str, tuple[Guard, ...]] = {
    "crf": (
        Guard("mapq.crf.energy", (f"{CRF}/test_energy.py",), borders=True),
        Guard("mapq.crf.likelihood", (f"{CRF}/test_train.py",), borders=True),
        Guard("mapq.crf.infer", (f"{CRF}/test_infer.py",), borders=True),
        Guard("mapq.crf.marginals", (f"{CRF}/test_marginals.py",), borders=True),
        Guard("mapq.crf.scaling", (f"{CRF}/test_scaling.py",), borders=True),
        Guard("mapq.crf.quadratic", (f"{CRF}/test_margin.py",), borders=True),
        Guard("mapq.crf.margin", (f"{CRF}/test_margin.py",), borders=True),
    ),
    "likelihoods": (
        Guard("prf.kernels.laser", ("tests/kernels/test_laser.py",)),
        Guard("prf.kernels.sonar", ("tests/kernels/test_sonar.py",)),
        Guard("prf.kernels.points", ("tests/kernels/test_points.py",)),
    ),
    "hastings": tuple(
        Guard(f"prf.kernels.moves.{name}", tuple(f"{DRAWS}[{move}]" for move in moves if move in DRAWN), moves)
        for name, moves in (
            ("interior_triangle", ("triangle birth", "triangle death")),
            ("boundary_triangle", ("boundary birth", "boundary death")),
            ("corner_cut", ("corner birth", "corner death")),
            ("split_edge", ("split", "merge")),
            ("move_vertex", ("move interior", "move boundary", "past corner", "slide")),
            ("recolor", ("recolor", "local recolor", "cut wall")),
            ("cut_wall", ("cut wall", "mend wall")),
            ("join_wall", ("join wall", "part wall")),
            ("gap", ("cut wall", "mend wall", "join wall", "part wall")),
            ("dock", ("dock", "undock")),
            ("notch", ("notch", "fill")),
            ("notch_shape", ("notch", "fill")),
            ("move_line", ("move line",)),
            ("lean", ("lean", "stand")),
            ("placing", ("triangle birth", "split", "cut wall", "join wall", "dock", "notch", "lean")),
        )
    ),
}
