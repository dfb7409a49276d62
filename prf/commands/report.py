"""Write a report on a run: one page of HTML that opens without a network."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from prf.shell.cli.options import Force, Output

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf report office",
    'prf report office --title "Second floor" -o floor.html',
    "prf report drive --truth drift/true_poses.csv",
)


def report(
    run: Annotated[str, typer.Argument(metavar="RUN", help="What prf sample wrote.")],
    title: Annotated[
        str | None, typer.Option("--title", metavar="TEXT", help="Instead of the names of the logs.")
    ] = None,
    truth: Annotated[
        str | None,
        typer.Option("--truth", metavar="FILE", help="True poses, as --poses takes them: errors of those sampled."),
    ] = None,
    output: Output = None,
    force: Force = False,
) -> None:
    """Write a report on a run: one page of HTML that opens without a network.

    The posterior with its unseen ground hatched, a slider over the draws, the best map, where the chains differ, and
    answers as prf query gives them: click a point for the probability that it is occupied, click the corners of a path
    for that of a disc to follow it. The page has all draws, or as many as fit into 2.5 MB, and states their number.
    Without -o it is RUN.html beside the folder. With --truth it shows absolute and relative errors (ATE, RPE) of the
    trajectory that was sampled, beside what was stated.
    """
    from prf.output.report import page_beside, true_errors, write_report
    from prf.output.run import read_run
    from prf.results import names
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import claim_output

    target = output or page_beside(run)
    inputs = [*(str(Path(run) / name) for name in names.SCHEMAS), *([truth] if truth else [])]
    claim_output(target, force, inputs=inputs, suffixes=(".html", ".htm"))
    source = read_run(run)
    errors = None if truth is None else true_errors(source, truth)
    if errors is not None:
        logger.info("%s", errors.words())
    n_bytes, n_embedded = write_report(target, source, title, errors)
    if target != STREAM:
        shown = f"{n_embedded:,} of {len(source.draws):,} draws"
        logger.info("wrote %s: %.1f MB, answers from %s", target, n_bytes / 1e6, shown)
