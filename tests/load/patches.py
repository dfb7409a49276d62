"""A map of a million patches: measured, labelled, written, read again and reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mapq.assess.inputs import feature_settings
from mapq.assess.judged import read_judged
from mapq.assess.result import Result
from mapq.crf import classify, explain
from mapq.features import patch_features
from mapq.io import read_patches, write_patches
from mapq.io.models import read_default_model
from mapq.io.results import json_beside, write_result
from mapq.report import read_findings, write_report
from tests.load.meter import Meter
from tests.load.town import town


def run(n_patches: int, folder: Path, meter: Meter) -> int:
    """Carry a map of so many patches from PATCHES to its report; return the bytes of the report."""
    model = read_default_model()
    with meter.stage("make, write and read PATCHES") as note:
        write_patches(folder / "town.patches", town(n_patches))
        patches = read_patches(folder / "town.patches")
        note.append(f"{len(patches):,} patches, {len(patches.cloud):,} points")
        (folder / "town.patches").unlink()
    with meter.stage("features") as note:
        features = patch_features(patches, feature_settings(model))
        note.append(f"{len(features.pairs):,} pairs")
    with meter.stage("random field") as note:
        labelling = classify(features, model)
        note.append(f"{int(labelling.label.sum()):,} suspicious")
    with meter.stage("terms") as note:
        terms = explain(features, model, labelling.label)
        note.append(f"{len(terms.patch):,} terms")
    result = Result(patches, features, model, labelling, terms)
    with meter.stage("regions and verdict") as note:
        head = result.head(0.05)
        note.append(f"{len(result.regions):,} regions")
    target = str(folder / "town.ply")
    with meter.stage("result") as note:
        write_result(target, result.cloud(), head, result.patch_rows())
        note.append(f"JSON {Path(json_beside(target)).stat().st_size / 1e6:,.0f} MB")
    del result, terms, features, patches, head
    with meter.stage("read to be compared") as note:
        judged = read_judged(target, None)
        note.append(f"{len(judged.xyz):,} points")
    del judged
    with meter.stage("report") as note:
        told = read_findings(target)
        written = write_report(str(folder / "town.html"), told)
        assert len(told.label) == len(labelling.label)
        np.testing.assert_array_equal(told.label, labelling.label)
        note.append(f"{written.n_bytes / 1e6:.1f} MB, tells of {len(told.rows):,}")
    return written.n_bytes
