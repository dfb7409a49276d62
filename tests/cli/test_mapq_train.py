from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from mapq.io import read_patches, write_patches
from mapq.io.journal import Event, Journal, journal_beside
from mapq.io.models import read_model
from tests.cli.mapq_samples import call, call_json, save_model, save_patches
from tests.mapq.labelled import draw_patches


def test_weights_and_held_out_scores_are_printed(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    paths = [save_patches(tmp_path, seed) for seed in (1, 2)]
    code, out, _ = call(capsys, "train", "-v", *paths)
    assert code == 0
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines()}
    model = read_model("model.json")
    printed = dict(each.split() for each in " ".join(rows["weights"]).split(", "))
    for name, weight in zip(model.parameter_names, model.weights, strict=True):
        assert float(printed[name]) == pytest.approx(weight, rel=1e-3)
    assert float(rows["accuracy"][0]) > 0.9
    assert "64 patches in 5 folds, 50.0% suspicious" in out


def test_options_reach_the_model(capsys, tmp_path):
    path, target = save_patches(tmp_path), tmp_path / "m.json"
    features = ("radius=2.5", "tau=0.7", "neighbours=3", "watched=7", "tolerance=0.2")
    field = ("regularisation=3", "coupling_regularisation=4", "class_weight=none")
    values = [*(f"features.{each}" for each in features), *(f"crf.{each}" for each in field)]
    options = [word for value in values for word in ("--set", value)]
    result = call_json(capsys, "train", path, "-o", target, *options, "--objective", "pl")
    assert result["schema"] == "mapq.model/4"
    assert result["output"] == str(target)
    features = result["features"]
    assert [features[key] for key in ("radius", "tau", "n_neighbours")] == [2.5, 0.7, 3]
    assert [features[key] for key in ("n_watched", "tolerance")] == [7, 0.2]
    training = result["training"]
    kept = [training[key] for key in ("regularisation", "coupling_regularisation", "class_weight", "objective")]
    assert kept == [3.0, 4.0, "none", "pl"]
    stored = json.loads(target.read_text())
    del result["output"]
    assert stored == result


def test_the_operating_point_is_stored_and_can_be_chosen_later(capsys, tmp_path):
    target, careful = tmp_path / "m.json", tmp_path / "careful.json"
    paths = [save_patches(tmp_path, seed) for seed in (1, 2)]
    plain = call_json(capsys, "train", *paths, "-o", target)
    chosen = call_json(capsys, "train", *paths, "--max-false-alarms", "0%", "-o", careful)
    points = plain["operating"]
    assert plain["threshold"] == 0.0
    assert points["false_alarms"][0] == 0.0
    assert chosen["threshold"] == points["threshold"][0]
    assert chosen["parameters"] == plain["parameters"]
    results = []
    for name, options in (("a", ["--model", careful]), ("b", ["--model", target, "--max-false-alarms", "0"])):
        results.append(call_json(capsys, "classify", paths[0], *options, "-o", tmp_path / f"{name}.ply"))
    assert results[0]["threshold"] == results[1]["threshold"]
    assert results[0]["threshold"]["difference"] == chosen["threshold"]
    cut = results[0]["threshold"]["p_suspicious"]
    for row in results[0]["patches"]:
        assert (row["label"] == "suspicious") == (row["difference"] >= chosen["threshold"] - 1e-9)
        assert (row["label"] == "suspicious") == (row["p_suspicious"] > cut - 1e-7)


def test_a_model_without_held_out_regions_has_no_operating_point(capsys, tmp_path):
    path = save_patches(tmp_path)
    options = ["--model", save_model(tmp_path), "--max-false-alarms", "1%"]
    for verb in ("classify", "evaluate"):
        code, out, err = call(capsys, verb, path, *options)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "has no operating points" in err


def test_maximum_margin_trains(capsys, tmp_path):
    paths = [save_patches(tmp_path, seed) for seed in (1, 2)]
    found = call_json(capsys, "train", *paths, "--objective", "max-margin", "-o", tmp_path / "m.json")
    assert found["training"]["objective"] == "max-margin"
    assert found["training"]["held_out"]["accuracy"] > 0.9
    assert min(found["parameters"]["coupling"].values()) >= 0.0


def test_labels_are_stored_in_the_file_itself_without_force(capsys, tmp_path):
    path = save_patches(tmp_path, labelled=False)
    code, out, err = call(capsys, "label", path, "--from-field", "truth")
    assert (code, err) == (0, "")
    assert ["suspicious", "16"] in [line.split() for line in out.splitlines()]
    found = read_patches(path)
    np.testing.assert_array_equal(found.label, draw_patches(1).label)
    np.testing.assert_array_equal(found.cloud.fields["intensity"], draw_patches(1).cloud.fields["intensity"])
    assert list(tmp_path.iterdir()) == [path]


def test_labels_by_hand_are_kept_unless_forced(capsys, tmp_path):
    path = tmp_path / "a.patches"
    patches = draw_patches(1)
    patches.label[0], patches.label_source[0] = 1, 2
    write_patches(path, patches)
    result = call_json(capsys, "label", path, "--from-field", "truth")
    assert (result["schema"], result["n_kept"], result["n_suspicious"]) == ("mapq.label/1", 1, 17)
    assert "set by hand     1, kept" in call(capsys, "label", path, "--from-field", "truth")[1]
    assert call_json(capsys, "label", path, "--from-field", "truth", "-f")["n_suspicious"] == 16


def test_labels_of_a_journal_are_kept_by_a_field_and_used_in_training(capsys, tmp_path):
    path = save_patches(tmp_path, labelled=False)
    journal = Journal(path, read_patches(path))
    journal.add(Event(0, 1))
    journal.add(Event(1, 255))
    result = call_json(capsys, "label", path, "--from-field", "truth")
    assert (result["n_kept"], result["n_suspicious"], result["n_unlabelled"]) == (2, 17, 1)
    assert not journal_beside(path).exists()
    Journal(path, read_patches(path)).add(Event(2, 1))
    model = tmp_path / "m.json"
    assert call(capsys, "train", path, "-o", model)[0] == 0
    trained = json.loads(model.read_text())["training"]
    assert (trained["n_patches"], trained["n_suspicious"]) == (31, 18)


class Running:
    """`mapq label PATCHES --no-browser` as its own process."""

    def __init__(self, path: Path, *options: object) -> None:
        root = Path(__file__).resolve().parents[2]
        command = [sys.executable, "-m", "mapq", "label", str(path), "--no-browser", "-q", *map(str, options)]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(root)},
        )
        assert self.process.stderr is not None
        for line in self.process.stderr:
            if found := re.search(r"http://\S+/\?token=(\S+)", line):
                self.url, self.token = found[0], found[1]
                return
        raise AssertionError("no address")

    def post(self, path: str, content: dict) -> dict:
        headers = {"Content-Type": "application/json", "X-Page-Token": self.token}
        request = urllib.request.Request(self.url.partition("?")[0] + path, json.dumps(content).encode(), headers)
        with urllib.request.urlopen(request, timeout=30) as answer:
            return json.load(answer)

    def end(self, number: int | None = None) -> tuple[int, str, str]:
        if number is not None:
            self.process.send_signal(number)
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out, err


@pytest.mark.slow
def test_labelling_by_hand_survives_a_kill(capsys, tmp_path):
    path = save_patches(tmp_path, labelled=False)
    first = Running(path)
    first.post("api/label", {"patch": 4, "label": "suspicious"})
    first.post("api/label", {"patch": 5, "label": "plausible"})
    code, _, err = call(capsys, "label", path, "--no-browser")
    assert (code, err.count("\n")) == (4, 1), "the second one is refused"
    assert first.end(signal.SIGKILL)[0] == -signal.SIGKILL
    assert read_patches(path).label[[4, 5]].tolist() == [1, 0]
    second = Running(path)
    assert second.post("api/undo", {})["patch"] == 5
    second.post("api/label", {"patch": 6, "label": "unsure"})
    code, out, err = second.end(signal.SIGINT)
    assert (code, out) == (130, "")
    assert "all 2 labels are in" in err
    assert list(tmp_path.iterdir()) == [path]
    assert np.flatnonzero(read_patches(path).label_source).tolist() == [4, 6]


def test_by_hand_to_its_end(tmp_path):
    path = save_patches(tmp_path, labelled=False)
    running = Running(path, "--json")
    running.post("api/label", {"patch": 4, "label": "suspicious"})
    running.post("api/finish", {})
    code, out, _ = running.end()
    assert code == 0
    result = json.loads(out)
    assert (result["schema"], result["n_by_hand"], result["n_suspicious"]) == ("mapq.label.hand/1", 1, 1)
    assert list(tmp_path.iterdir()) == [path]
