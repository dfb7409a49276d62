"""What the sonar experiment computes itself: shares of whole scans, and the comparison with the grids."""

from __future__ import annotations

import gzip
import itertools
from pathlib import Path
from typing import Any

from benchmarks import figure5


def test_shares_are_whole_scans_without_those_held_out() -> None:
    scans = list(range(200))
    everything = figure5.mapping_scans(scans, 100.0)
    assert everything == [scan for scan in scans if scan % 10 != 5]
    for percent in (5.0, 10.0, 25.0, 50.0):
        some = figure5.mapping_scans(scans, percent)
        assert set(some) < set(everything)
        assert len(some) == int(len(everything) * percent / 100)
        gaps = [b - a for a, b in itertools.pairwise(some)]
        assert max(gaps) - min(gaps) <= 2, "spread evenly over the drive, but for the scans held out"


def test_a_share_keeps_the_rows_of_the_log(tmp_path: Path) -> None:
    lines = ["x,y,theta,range,scan", *(f"1.5,2.5,{k}.0,,{scan}" for scan in range(40) for k in range(3))]
    log = tmp_path / "sonar.csv.gz"
    log.write_bytes(gzip.compress("\n".join(lines).encode()))
    n = figure5.write_share(figure5.read_rows(log), 50.0, tmp_path / "half" / "sonar.csv")
    written = (tmp_path / "half" / "sonar.csv").read_text().splitlines()
    assert n == len(written) - 1 == 18 * 3
    assert written[0] == lines[0]
    assert set(written) <= set(lines)


def row(kind: str, iou: float, nll: float, **changes: Any) -> dict[str, Any]:
    """Return scores of a map."""
    return {
        "share": 5.0,
        "settings": "fitted",
        "map": kind,
        "iou_occupied": iou,
        "iou_free": 0.9,
        "sonar_nll": nll,
        **changes,
    }


def test_the_prf_must_be_ahead_of_the_better_grid_of_each_measure() -> None:
    grids = [row("count grid", 0.1, 1.0, iou_free=0.8), row("log-odds grid", 0.3, 2.0, iou_free=0.7)]
    assert figure5.lost([row(figure5.POSTERIOR, 0.4, 0.5), *grids]) == []
    found = figure5.lost([row(figure5.POSTERIOR, 0.2, 1.5), *grids])
    assert found == [
        "PRF posterior, fitted, 5 %, iou_occupied: 0.200 against 0.300",
        "PRF posterior, fitted, 5 %, sonar_nll: 1.500 against 1.000",
    ]
    assert (
        figure5.lost([row(figure5.BEST, 0.1, 9.0, share=10.0), row("count grid", 0.0, 9.1, share=10.0, iou_free=0.0)])
        == []
    )


def test_the_table_has_a_row_a_map_of_one_setting() -> None:
    rows = [row(figure5.POSTERIOR, 0.25, 0.5, cell_brier=0.1), row("count grid", 0.1, 1.0, settings="defaults")]
    assert figure5.table(rows, "fitted").splitlines()[2:] == ["| 5 % | PRF posterior | 0.250 | 0.900 | 0.500 | 0.100 |"]
