"""Mistakes that users make: each is answered by one line that names it, and leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.calls import call, content

LASER, SONAR = "--laser laser.log", "--sonar sonar.csv"
FIT = "prf calibrate --map room.geojson"
SIMULATE = "prf simulate -o out"
CLASSIFY = "mapq classify walls.patches --model model.json"
CASES = (
    ("prf anneal", 2, "--laser"),
    ("prf anneal laser.log", 2, "--laser"),
    (f"prf anneal {LASER} --steps 1 --time-budget 1", 2, "one of them"),
    (f"prf anneal {LASER} -o - --json", 2, "standard output"),
    (f"prf calibrate {SONAR}", 2, "--map"),
    (FIT, 2, "--sonar"),
    (f"{FIT} {SONAR} --set sonar.max_range=-1", 2, "sonar.max_range"),
    (f"{FIT} {SONAR} --json -o -", 2, "standard output"),
    ("prf export run", 2, "no format"),
    ("prf export run -o out.txt", 2, "out.txt: its suffix names no format"),
    ("prf export run --format ros-map -o -", 2, "pair of files"),
    ("prf export run --format netcdf -o -", 2, "binary"),
    ("prf export run -o out.svg --unknown 0 1", 2, "--unknown is for"),
    ("prf export run -o out.nc --draw 1", 2, "--draw is for maps"),
    ("prf export run -o out.svg --draw 4", 2, "draws 0 to 3"),
    ("prf export run -o out.yaml --unknown 0.7 0.2", 2, "lower one first"),
    ("prf export run -o no/such/folder/a.svg", 4, "cannot be written"),
    (f"prf grid {LASER} -o out.npz --resolution 0", 2, "--resolution"),
    ("prf grid -o out.npz", 2, "--laser"),
    (f"prf grid {LASER} -o out.npz --set prior.scale=1 --set sampler.chains=2", 2, "[sampler] is not read here"),
    (f"prf grid {LASER} -o out.png", 2, "out.png"),
    ("prf prior --scale 1 --window 0 0 1 1 --draws 0", 2, "--draws"),
    ("prf prior --scale 1 --window 0 0 1 1 --draws 1 --thin 5", 2, "--thin"),
    ("prf prior --scale 0 --window 0 0 1 1 --draws 1", 2, "scale"),
    ("prf prior --scale 1 --window 0 0 0 1 --draws 1", 2, "window"),
    ("prf query run", 2, "either --points"),
    ("prf query run --path points.csv", 2, "--radius"),
    ("prf query run --points points.csv --radius 1", 2, "--radius"),
    ("prf query run --points points.csv --square -1", 2, "square -1"),
    ("prf query run --path points.csv --radius nan", 2, "radius nan"),
    (f"prf sample {SONAR} --sonar-max-range 0 -o out", 2, "sonar-max-range"),
    (f"prf sample {SONAR} --sonar-cone 3.2 -o out", 2, "--sonar-cone"),
    (f"prf sample {SONAR} --window 20 20 30 30 -o out", 3, "no sensor stands inside"),
    ("prf sample -o out", 2, "--sonar LOG"),
    ("prf sample --laser - --sonar - -o out", 2, "once"),
    ("prf sample --point-data - --laser - -o out", 2, "once"),
    ("prf sample --point-data values.csv --window 20 20 30 30 -o out", 3, "no point lies inside the window"),
    ("prf score run", 2, "--laser"),
    (f"prf score run {LASER} --noise 0", 2, "noise"),
    (f"prf score run {LASER} --square -1", 2, "square"),
    (f"prf score run {LASER} {SONAR} --pose-noise 0.1 0.1", 2, "no --sonar"),
    ("prf simulate", 2, "-o"),
    (f"{SIMULATE} --size 2 2", 2, "size"),
    (f"{SIMULATE} --scale 1", 2, "--scale is for --world arak"),
    (f"{SIMULATE} --no-laser", 2, "no sensor"),
    (f"{CLASSIFY} -o -", 2, "two files"),
    (f"{CLASSIFY} -o out.json", 2, "two files"),
    (f"{CLASSIFY} -o out/", 2, "name of a folder"),
    ("mapq segment cloud.ply -o out/", 2, "name of a folder"),
    (f"{CLASSIFY} -o out.ply --max-tilt 10", 2, "segmented already"),
    (f"{CLASSIFY} -o out.ply --unit ft", 2, "holds its unit"),
    (f"{CLASSIFY} -o out.ply --topic t", 2, "leave the topic out"),
    (f"{CLASSIFY} -o no/such/folder/out.ply", 4, "there is no folder"),
    (f"{CLASSIFY} -o out.ply --fail-over 5", 2, "Give one such as 0.05 or 5%"),
    (f"{CLASSIFY} -o out.ply --fail-over nan", 2, "Give one such as 0.05 or 5%"),
    (f"{CLASSIFY} -o out.copc.laz", 2, "COPC is not written"),
    ("mapq compare walls.patches walls.patches --model model.json --cell 0", 2, "no length"),
    ("mapq evaluate cloud.ply", 3, "neither PATCHES nor a result"),
    ("mapq evaluate walls.patches --model model.json --truth-field wrong", 3, "no point field wrong"),
    ("mapq evaluate result.ply --model model.json", 2, "Leave out --model"),
    ("mapq features walls.patches --csv --json", 2, "--json"),
    ("mapq features walls.patches --set features.context=['colour']", 2, "no context colour"),
    ("mapq render cloud.ply -o out.txt", 2, "out.txt"),
    ("mapq segment cloud.ply -o out.patches --set crf.folds=3", 2, "[crf] is not read here"),
    ("mapq segment -", 2, "Name the output with -o"),
    ("mapq segment cloud.ply --set segment.max_angle=0 -o out.patches", 2, "segment.max_angle must be above 0"),
    ("mapq segment cloud.ply --set segment.neighbours=2 -o out.patches", 2, "segment.neighbours must be from 3 to 64"),
    ("mapq segment cloud.ply --max-tilt 95 -o out.patches", 2, "--max-tilt must be from 0 to 90"),
    ("mapq classify walls.patches --preset velodyne-vlp16 -o out.ply", 2, "a --preset is for clouds"),
    ("mapq simulate", 2, "-o"),
    ("mapq simulate -o out.ply --drift -1", 2, "drift -1"),
    ("mapq simulate -o no/such/folder/out.ply", 4, "no/such/folder"),
    ("mapq train walls.patches -o out.json --set crf.regularisation=0", 2, "regularisation 0.0"),
    ("mapq train walls.patches -o out.json --set features.radius=-1", 2, "radius"),
    ("mapq train walls.patches --json -o -", 2, "both want standard output"),
    ("mapq train bare.patches -o out.json", 3, "mapq label"),
)


@pytest.mark.parametrize(("line", "code", "words"), CASES, ids=[line for line, _, _ in CASES])
def test_a_mistake_is_one_line(line: str, code: int, words: str, folder: Path) -> None:
    before = content(folder)
    done = call(line, folder, *([] if "--json" in line or "--csv" in line else ["-q"]))
    assert (done.code, done.out) == (code, ""), done
    assert done.err.count("\n") == 1, done.err
    assert words in done.err
    assert content(folder) == before
