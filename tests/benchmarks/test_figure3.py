"""The scene of figure 3: sums that are 1, and features of both kinds."""

from __future__ import annotations

import pytest

from benchmarks import figure3
from prf.model.sonar import SonarModel


def test_the_scene_has_a_bit_of_everything_and_its_sums_are_one() -> None:
    sight = figure3.look(SonarModel())
    rows = figure3.rows_of(sight)
    assert {row["kind"] for row in rows} == {"surface", "corner"}
    assert sum(row["share"] for row in rows) + sight.returns.none == pytest.approx(1.0, abs=1e-12)
    assert figure3.sums(sight)["density"] == pytest.approx(1.0, abs=1e-9)
    surfaces = [row for row in rows if row["kind"] == "surface"]
    assert len(figure3.visible_parts(sight)) == len(surfaces)
