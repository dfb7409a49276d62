"""Compile the kernels ahead: for container images, CI, and machines that must answer at once."""

from __future__ import annotations

from typing import Annotated

import typer

from prf.shell.cli.options import Json

EXAMPLES = ("mapq warm", "mapq warm --for classify", "MAPQ_CACHE_DIR=/opt/mapq mapq warm -q")

MADE = "simulate --size small --n-points 60000 --seed 1 -o town.ply"
COMMANDS = {
    "classify": (
        MADE,
        "segment town.ply --surfaces upright,level,curved -o town.patches",
        "segment town.ply --set segment.resolution=0.3 -o coarse.patches",
        "classify town.patches -o result.ply",
    ),
    "features": (MADE, "segment town.ply -o town.patches", "features town.patches --json"),
}
"""Kind of job to calls of `mapq` that between them call every kernel it needs."""


def warm(
    context: typer.Context,
    jobs: Annotated[
        list[str] | None,
        typer.Option("--for", metavar="JOB", help=f"{', '.join(COMMANDS)}; repeat for several.  [all]"),
    ] = None,
    json: Json = False,
) -> None:
    """Compile the kernels ahead: for container images, CI, and machines that must answer at once.

    Otherwise the first call of a verb compiles what it needs. Kernels are kept for this version, this Python and this
    kind of processor in $MAPQ_CACHE_DIR, or else in ~/.cache/mapq/kernels, where whoever runs mapq must be able to
    write. A second call has nothing to do.
    """
    from mapq.kernels._jit import CACHE
    from prf.shell.jit.warming import Job, report
    from prf.shell.jit.warming import warm as run

    calls = {name: Job(lines) for name, lines in COMMANDS.items()}
    report("mapq", run(context.find_root().command, "mapq", CACHE, calls, {}, jobs or []), json)
