"""Write a report on a result: one page of HTML that opens without a network."""

from __future__ import annotations

import logging
import os
from typing import Annotated

import typer

from mapq.commands._options import default_name, named_after
from prf.shell.cli.options import Force, Output

logger = logging.getLogger(__name__)

EXAMPLES = (
    "mapq report city.classified.ply",
    "mapq report city.classified.laz -o city.html",
    'mapq report city.classified.ply --title "City, second survey" --max-points 50000 -o city.html',
)


def report(
    result: Annotated[
        str,
        typer.Argument(metavar="RESULT", help="What mapq classify wrote, its JSON beside it or in the folder."),
    ],
    max_points: Annotated[
        int,
        typer.Option("--max-points", metavar="N", min=1_000, max=2_000_000, help="Points that the views show, about."),
    ] = 120_000,
    title: Annotated[
        str | None, typer.Option("--title", metavar="TEXT", help="Instead of the name of the file.")
    ] = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Write a report on a result: one page of HTML that opens without a network.

    The verdict with a histogram of probabilities, plan view and 3D view, regions worst first, and a table of patches. A
    click on a patch, in a view or in the table, shows its features, its label with its probability, and the reasons in
    words. Of a result in tiles a part of the points is read. Without -o the page is beside RESULT: its name with .html.
    """
    from mapq.posed.files import refuse_run
    from mapq.report.findings import read_findings
    from mapq.report.page import write_report
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import claim_output

    refuse_run(result)
    folder = os.path.isdir(result)
    target = output or (default_name([result], ".html") if folder else named_after(result, ".html"))
    inputs = [result, os.path.splitext(result)[0] + ".json"]
    claim_output(target, force, inputs=inputs, suffixes=(".html", ".htm"))
    findings = read_findings(result)
    n_bytes, n_shown = write_report(target, findings, title, max_points)
    if not len(findings.label):
        logger.warning("%s: no patch was found, so nothing of this map was judged", result)
    if target != STREAM:
        shown = f"{n_shown:,} of {findings.n_points:,} points"
        logger.info("wrote %s: %.1f MB, its views show %s", target, n_bytes / 1e6, shown)
