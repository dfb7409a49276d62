"""Maps in tiles on the command line: folders of tiles, workers, cities, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mapq.io import read_cloud
from tests.cli.mapq_samples import call, call_json

CITY = ("simulate", "--size", "city", "--n-points", 147_000, "--seed", 5)


@pytest.fixture(scope="module")
def city(tmp_path_factory) -> Path:
    from mapq.simulate.city import write_city

    folder = tmp_path_factory.mktemp("map") / "city"
    write_city(folder, 147_000, 5)
    return folder


def test_a_city_is_made(capsys, tmp_path):
    target = tmp_path / "city"
    made = call_json(capsys, *CITY, "-o", target)
    assert (made["schema"], made["seed"], made["tiles"]) == ("mapq.city/1", 5, 1)
    assert made["points"] == len(read_cloud(str(target / "tile_000_000.laz")))
    code, _, err = call(capsys, *CITY, "-o", target)
    assert (code, "already exists" in err) == (4, True)
    code, out, _ = call(capsys, *CITY, "-o", target, "-f")
    assert code == 0
    assert "tiles           1 in" in out


@pytest.mark.slow
def test_a_folder_gives_a_folder(capsys, city):
    code, out, _ = call(capsys, "classify", city, "--fail-over", "1%", "--json")
    assert code == 1
    content = json.loads(out)
    target = city.with_name("city.classified")
    assert content["output"] == str(target)
    assert sorted(path.name for path in target.iterdir()) == ["result.json", "tile_000_000.laz"]
    stored = json.loads((target / "result.json").read_text())
    assert stored["patches"] == content["patches"]
    assert stored["verdict"] == content["verdict"]
    assert 0.0 < stored["verdict"]["coverage"] < 1.0
    cloud = read_cloud(str(target / "tile_000_000.laz"))
    assert np.bincount(cloud.fields["patch"] + 1)[1:].tolist() == [row["n_points"] for row in stored["patches"]]
    code, _, err = call(capsys, "classify", city)
    assert (code, "already exists" in err) == (4, True)


@pytest.mark.slow
def test_two_workers_change_nothing(capsys, city, tmp_path):
    laz = city / "tile_000_000.laz"
    args = ["classify", laz, "--tile-points", 80_000, "-o"]
    for name, options in (("one.laz", []), ("two.laz", ["--workers", 2])):
        assert call(capsys, *args, tmp_path / name, *options)[0] == 0
    one, two = (read_cloud(str(tmp_path / name)) for name in ("one.laz", "two.laz"))
    np.testing.assert_array_equal(one.fields["patch"], two.fields["patch"])
    np.testing.assert_array_equal(one.fields["p_suspicious"], two.fields["p_suspicious"])
    rows = [json.loads((tmp_path / name).read_text())["patches"] for name in ("one.json", "two.json")]
    assert rows[0] == rows[1]


def test_a_folder_is_not_written_to_standard_output(capsys, city):
    code, _, err = call(capsys, "classify", city, "--workers", 2, "-o", "-")
    assert (code, "standard output" in err, err.count("\n")) == (2, True, 1)


def test_a_damaged_tile_is_named(capsys, city, tmp_path):
    folder = tmp_path / "tiles"
    folder.mkdir()
    data = (city / "tile_000_000.laz").read_bytes()
    (folder / "whole.laz").write_bytes(data)
    (folder / "cut.laz").write_bytes(data[: len(data) // 2])
    code, _, err = call(capsys, "classify", folder, "-o", tmp_path / "out")
    assert (code, "cut.laz" in err, err.count("\n")) == (3, True, 1)
    assert not (tmp_path / "out").exists()
