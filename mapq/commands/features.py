"""Show the features of every patch and of every pair of neighbours."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.configuration import Configuration
from prf.shell.cli.console import is_verbose
from prf.shell.cli.options import Json, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from mapq.features.table import PatchFeatures, Table

EXAMPLES = (
    "mapq features map.patches",
    "mapq features map.patches --csv > features.csv",
    "mapq features map.patches --json --set features.radius=2 --set features.tau=0.5",
)
SHOWN = ("area_m2", "thickness_m", "tilt_deg", "separation", "overlap", "crossing", "plausibility")
"""Columns that are summed up without -v."""


@with_settings(Configuration, "features")
def features(
    patches: Annotated[str, typer.Argument(metavar="PATCHES", help="What mapq segment wrote; - is standard input.")],
    *,
    settings: Loaded[Configuration],
    csv: Annotated[
        bool, typer.Option("--csv", help="Print CSV: a row a patch, an empty line, then a row a pair.")
    ] = False,
    json: Json = False,
) -> None:
    """Show the features of every patch and of every pair of neighbours.

    Nodes: how well a patch's points make a plane (equations 6-8), and its size. Edges: how a patch lies to the closest
    ones (equations 9-12), and the plausibility x_ij of that (equation 13), low where walls are doubled or cross. -v
    sums up all columns.
    """
    from mapq.api import patch_features
    from mapq.features.table import csv_lines, edge_table, node_table, records
    from mapq.io import read_patches
    from prf.shell.cli import console, storage
    from prf.shell.errors import UsageError

    if csv and json:
        raise UsageError("--csv and --json do not go together.")
    found = patch_features(read_patches(patches), settings.settings.features, progress=True)
    tables = {"nodes": node_table(found), "edges": edge_table(found)}
    if json:
        units = {name: dict(zip(table.names, table.units, strict=True)) for name, table in tables.items()}
        content = {name: records(table) for name, table in tables.items()}
        head = {"parameters": found.parameters, "n_patches": len(found.node), "n_pairs": len(found.pairs)}
        storage.emit_object("mapq.features/1", {**head, "units": units, **content})
    elif csv:
        console.emit("\n\n".join("\n".join(csv_lines(table)) for table in tables.values()))
    else:
        for line in _lines(found, tables):
            console.emit(line)


def _lines(found: PatchFeatures, tables: dict[str, Table]) -> Iterator[str]:
    """Yield the table for a person."""
    from mapq.features.table import summed_up

    used = found.parameters
    yield f"{'patches':<16}{len(found.node)}"
    closest = f"the {used['n_neighbours']} closest of each within {used['radius']:g} m, tau {used['tau']:g} m"
    yield f"{'pairs':<16}{len(found.pairs)}, {closest}"
    yield f"{'noise':<16}{used['noise']:.3g} m"
    for name, table in tables.items():
        yield f"\n{name:<18}{'5 %':>12}{'median':>12}{'95 %':>12}  unit"
        for column, unit, values in summed_up(table):
            if is_verbose() or column in SHOWN:
                numbers = "".join(f"{value:>12.4g}" for value in values)
                yield f"{column:<18}{numbers}  {'' if unit == '1' else unit}".rstrip()
