"""Negative controls: each mistake in a move is caught by the check that is meant for it, and the intact copy passes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.reference.hastings import NAMES, TOLERANCE
from tests.statistical import mutants
from tests.statistical.means import largest

SEED = 20050726
SUSPECTS = {
    mutants.SLIDE: {"slide"},
    mutants.NO_WAY_BACK: {"local recolor"},
    mutants.COUNTS: {"local recolor"},
    mutants.BIRTH: {"triangle birth", "triangle death"},
    mutants.MERGE: {"merge"},
    mutants.LINK_COUNTS: {"cut wall", "join wall", "part wall", "fill", "unbend"},
    mutants.MEND_EDGES: {"mend wall"},
    mutants.ONE_FACE: {"cut wall", "mend wall"},
    mutants.ONE_EDGE: {"join wall"},
    mutants.ONE_ORDER: {"dock"},
    mutants.NOTCH_WALLS: {"notch"},
    mutants.BEND_WALLS: {"bend"},
    mutants.ONE_SIZE: {"triangle birth", "triangle death"},
}


def test_what_a_mistake_replaces_is_there_once() -> None:
    mistakes = [one for one in vars(mutants).values() if isinstance(one, mutants.Mutant)]
    assert len(mistakes) > len(SUSPECTS)
    for mutant in mistakes:
        for file, old, _ in mutant.replacements:
            assert (mutants.ROOT / "prf" / "kernels" / "moves" / file).read_text().count(old) == 1, (mutant.name, old)


def wrong_moves(found: dict[str, Any]) -> set[str]:
    """Moves whose ratio is not that of the reference, or that misbehave."""
    return {
        name
        for name, move in found["moves"].items()
        if move["valid"] == 0 or move["problems"] or not move["reference_error"] < TOLERANCE
    }


@pytest.mark.slow
@pytest.mark.parametrize("mutant", [pytest.param(one, id=one.name) for one in (mutants.INTACT, *SUSPECTS)])
def test_hastings_check_names_the_wrong_move(mutant: mutants.Mutant, tmp_path: Path) -> None:
    found = mutants.run_check(tmp_path, mutant, "tests.reference.hastings", "4", str(SEED), compiled=False)
    assert set(found["moves"]) == set(NAMES)
    assert wrong_moves(found) == SUSPECTS.get(mutant, set())


@pytest.mark.slow
def test_antisymmetry_alone_passes_a_wrong_slide(tmp_path: Path) -> None:
    found = mutants.run_check(tmp_path, mutants.SLIDE, "tests.reference.hastings", "2", str(SEED), compiled=False)
    slide = found["moves"]["slide"]
    assert slide["antisymmetry_error"] < TOLERANCE
    assert slide["reference_error"] > 0.1


OFTEN_LOCAL = ("LOCAL_RECOLOR=1.5",)
"""Three steps of five are local recolourings: their mistakes are not drowned by the moves that are right."""
OFTEN_WALLS = ("scale=2", "cell=0.15", "birth_reach=0.1", "cut_reach=0.03", "CUT_WALL=1", "MEND_WALL=1")
"""Two steps of three cut or mend, in a map of 58 edges: some 100 of each in a million steps are accepted."""
OFTEN_CORNERS = (
    "scale=2",
    "cell=0.15",
    "cut_reach=0.03",
    "join_reach=0.1",
    "targets=60",
    *(
        f"{move}=0.3"
        for move in (
            *("JOIN_WALL", "PART_WALL", "DOCK", "UNDOCK", "NOTCH", "FILL"),
            *("BEND", "UNBEND"),
        )
    ),
)
"""Two steps of three join or part, notch or fill, or bend or unbend."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "odds",
    [(), OFTEN_LOCAL, OFTEN_WALLS, OFTEN_CORNERS],
    ids=["default odds", "often local", "often walls", "often corners"],
)
def test_intact_copy_obeys_the_laws(odds: tuple[str, ...], tmp_path: Path) -> None:
    arguments = ("tests.statistical.prior_chain", "20000000", str(SEED), *odds)
    found = mutants.run_check(tmp_path, mutants.INTACT, *arguments, compiled=True)
    assert found["relative_error_edges"] < 0.01
    assert len(found["z"]) > 60
    # 71 numbers a run, each beyond 4.5 by chance once in 53,000 (Student, 100 batches).
    assert largest(found["z"])[1] < 4.5, (SEED, largest(found["z"]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mutant", "steps", "odds"),
    [
        pytest.param(mutants.SLIDE, 4_000_000, (), id=mutants.SLIDE.name),
        pytest.param(mutants.NO_WAY_BACK, 4_000_000, OFTEN_LOCAL, id=mutants.NO_WAY_BACK.name),
        pytest.param(mutants.BIRTH, 4_000_000, (), id=mutants.BIRTH.name),
        pytest.param(mutants.MERGE, 20_000_000, (), id=mutants.MERGE.name),
        pytest.param(mutants.LINK_COUNTS, 8_000_000, OFTEN_WALLS, id=mutants.LINK_COUNTS.name),
        pytest.param(mutants.ONE_ORDER, 4_000_000, OFTEN_CORNERS, id=mutants.ONE_ORDER.name),
    ],
)
def test_laws_catch_the_mistake(mutant: mutants.Mutant, steps: int, odds: tuple[str, ...], tmp_path: Path) -> None:
    arguments = ("tests.statistical.prior_chain", str(steps), str(SEED), *odds)
    found = mutants.run_check(tmp_path, mutant, *arguments, compiled=True)
    assert largest(found["z"])[1] > 6.0, (SEED, largest(found["z"]))
