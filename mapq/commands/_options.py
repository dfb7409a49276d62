"""Options that several verbs of `mapq` share, beside those of :mod:`prf.shell.options`."""

from __future__ import annotations

from typing import Annotated

import typer

BinColumns = Annotated[
    int,
    typer.Option("--bin-columns", metavar="N", min=3, max=4, help="Columns of a KITTI .bin: 4 with intensity, or 3."),
]
