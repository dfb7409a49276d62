"""Show the contents of a file: a cloud, PATCHES, a RESULT, or a model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import typer

from mapq.commands._options import cloud_options
from mapq.configuration import Configuration
from prf.shell.cli.console import is_verbose
from prf.shell.cli.options import Json, with_settings
from prf.shell.cli.settings import Loaded

EXAMPLES = (
    "mapq inspect map.pcd",
    "mapq inspect survey.laz --json",
    "mapq inspect scan.bin --set cloud.bin_columns=3",
)
MOST_ROWS = 15
"""Lines that are printed without -v."""


@with_settings(Configuration, "cloud")
def inspect(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="A cloud (PLY, PCD, LAS/LAZ, E57, PTX, XYZ/TXT/CSV, .npy, .npz, 3DTK .3d, KITTI .bin, ROS bag; "
            "also gzipped), PATCHES, a RESULT (also a folder of tiles) or a model; - is standard input.",
        ),
    ],
    *,
    settings: Loaded[Configuration],
    json: Json = False,
) -> None:
    """Show the contents of a file: a cloud, PATCHES, a RESULT, or a model.

    The kind is recognised from the content. Of points it shows extent, fields and spacing (median distance to the
    nearest neighbour, on a sample); of patches the counts, labels and parameters; of a model its entries. -v prints all
    of a long table.
    """
    from mapq.io.describe import describe
    from prf.shell.cli import console, storage

    summary = describe(file, cloud_options(file, settings))
    if json:
        storage.emit_object("mapq.inspect/1", storage.jsonable(summary))
    else:
        rows = list(_rows(summary))
        width = max(16, *(len(name) + 2 for name, _ in rows))
        shown = rows if is_verbose() or len(rows) <= MOST_ROWS else rows[: MOST_ROWS - 1]
        for name, value in shown:
            console.emit(f"{name:<{width}}{value}".rstrip())
        if len(shown) < len(rows):
            console.emit(f"{'...':<{width}}{len(rows) - len(shown)} more, with -v")


def _rows(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "file", summary["path"]
    yield "kind", f"{summary['kind']} ({summary['format']})"
    if summary["cloud"] is not None:
        yield from _cloud_rows(summary["cloud"])
    if summary["patches"] is not None:
        yield from _patch_rows(summary["patches"])
    if summary["cloud"] is not None:
        lines = [_field_line(field) for field in summary["cloud"]["fields"]] or ["none"]
        yield from zip(["fields", *[""] * (len(lines) - 1)], lines, strict=True)
    yield from _flat(summary["content"])


def _cloud_rows(cloud: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    low, high, unit, shift = (cloud[name] for name in ("low", "high", "unit", "shift"))
    missing = cloud["n_points"] - cloud["n_finite"]
    size = " x ".join(f"{length:.2f}" for length in ((high - low) * unit).tolist())
    sides = ", ".join(f"{axis} {first:.2f} to {last:.2f}" for axis, first, last in zip("xyz", low, high, strict=True))
    yield "points", f"{cloud['n_points']:,}" + (f", {missing:,} of them without coordinates" if missing else "")
    is_metric = bool((unit == 1.0).all())
    in_units = "" if is_metric else " (file units)"
    yield "extent", f"{size} m, {sides}{in_units}"
    yield "coordinates", cloud["coordinate_type"] + (", taken to be in metres (else --unit)" if is_metric else "")
    if not is_metric:
        units = " ".join(f"{value:g}" for value in unit.tolist())
        yield "unit", f"{units} m, of x, y and z; lengths are in metres"
    if shift.any():
        words = " ".join(f"{value:.0f}" for value in shift)
        yield "shift", f"{words}{' m' if is_metric else in_units}, taken off before all work"
    spacing = cloud["spacing"]
    yield "spacing", "unknown" if _is_nan(spacing) else f"{spacing:.4g} m, median to the nearest neighbour"


def _field_line(field: Mapping[str, Any]) -> str:
    values = "no finite values" if _is_nan(field["low"]) else f"{field['low']:g} to {field['high']:g}"
    several = f" x {field['n_values']}" if field["n_values"] > 1 else ""
    return f"{field['name']}  {field['type']}{several}  {values}"


def _patch_rows(patches: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    median = patches["points_per_patch"]
    each = "" if _is_nan(median) else f", {median:g} a patch (median)"
    yield "patches", f"{patches['n_patches']:,}"
    yield "in patches", f"{patches['n_points_in_patches']:,} points{each}"
    yield "labels", _counts(patches["labels"])
    if patches["label_sources"]:
        yield "labels set", _counts(patches["label_sources"])


def _flat(value: Mapping[str, Any], name: str = "") -> Iterator[tuple[str, str]]:
    """Yield dotted names and values of JSON."""
    for key, item in value.items():
        full = f"{name}.{key}" if name else str(key)
        if isinstance(item, Mapping):
            yield from _flat(item, full)
        elif isinstance(item, list):
            yield full, " ".join(map(str, item))
        else:
            yield full, "-" if item is None else str(item)


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{n:,} {kind}" for kind, n in counts.items())


def _is_nan(value: float) -> bool:
    return value != value
