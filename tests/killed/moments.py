"""One moment: a command is killed at it, what it left is judged, and the next command has to cope with that."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.killed.child import Child, complete
from tests.killed.verbs import Digest, Verb


class Known(NamedTuple):
    """An uninterrupted run of a verb: what it gave, and the seconds that it took."""

    verb: Verb
    whole: Digest
    seconds: float


class Moment(NamedTuple):
    """What came of a kill: "absent", "whole", "best so far", "resumable" or "wrong", and what is wrong."""

    verb: str
    share: float
    state: str
    faults: list[str]


def run_whole(verb: Verb, inputs: Path, folder: Path) -> Known:
    """Run a verb uninterrupted; the second of two runs, with warm caches, is measured and compared with the first."""
    found = []
    for number in range(2):
        place = folder / f"{verb.name.replace(' ', '-')}-{number}"
        verb.put_inputs(inputs, place)
        code, err, seconds = complete(verb.command(inputs, place))
        assert code == 0, f"{verb.name}: {err}"
        found.append(verb.digest(place))
    assert _differing(*found) == [], f"{verb.name}: two runs differ in {_differing(*found)}"
    return Known(verb, found[1], seconds)


def kill_once(known: Known, inputs: Path, folder: Path, rng: np.random.Generator) -> Moment:
    """Kill a verb at a random moment, later ones more probable: there files are written."""
    verb, share = known.verb, float(np.sqrt(rng.random()))
    shutil.rmtree(folder, ignore_errors=True)
    verb.put_inputs(inputs, folder)
    before = verb.digest(folder)
    faults = _kill(verb.command(inputs, folder), share * known.seconds)
    state = _state(verb, folder, before, known.whole)
    if state == "resumable":
        faults += _resume(known, inputs, folder, rng)
    elif state == "absent":
        faults += _again(known, inputs, folder)
    elif state == "whole":
        faults += _left(verb, folder, known.whole)
    return Moment(verb.name, share, "wrong" if faults else state, faults)


def stop_once(known: Known, inputs: Path, folder: Path, number: signal.Signals, rng: np.random.Generator) -> Moment:
    """Send SIGINT or SIGTERM at a random moment after the first instants, in which Python and the tool start."""
    verb, share = known.verb, float(rng.random())
    shutil.rmtree(folder, ignore_errors=True)
    verb.put_inputs(inputs, folder)
    before = verb.digest(folder)
    with Child(verb.command(inputs, folder)) as child:
        child.signal_after(max(verb.start_up, share * known.seconds), number)
        code, _, err = child.end()
        faults = [f"{len(child.orphans())} workers live on"] if child.orphans() else []
    state = _state(verb, folder, before, known.whole)
    if verb.best_so_far and code == 128 + number and sorted(verb.digest(folder)) == sorted(known.whole):
        state = "best so far"
    # Python may end by SIGINT itself, where that came in an import, and by both at its very end: a shell sees the same.
    by_itself = code == -number and (number == signal.SIGINT or state in ("whole", "resumable"))
    if code not in (0, 128 + number) and not by_itself:
        faults.append(f"exit code {code}")
    if "Traceback" in err or err.count("\n") > 1:
        faults.append(f"more than a line: {err.strip()[-2000:]}")
    faults += [f"{name} is left" for name in _litter(folder)]
    if state == "resumable":
        faults += _resume(known, inputs, folder, rng)
    return Moment(f"{verb.name}, {number.name}", share, "wrong" if faults else state, faults)


def _kill(command: list[str], seconds: float) -> list[str]:
    """Kill the leader so long after its start; return what is wrong then."""
    with Child(command) as child:
        child.signal_after(seconds, signal.SIGKILL)
        child.process.wait()
        orphans = child.orphans()
        return [f"{len(orphans)} workers live on"] if orphans else []


def _state(verb: Verb, folder: Path, before: Digest, whole: Digest) -> str:
    """Return what a killed command left."""
    try:
        found = verb.digest(folder)
    except Exception:
        return "wrong"
    if verb.resumes is not None:
        return "resumable" if "manifest.json" in found else "absent"
    if not _differing(found, before):
        return "absent"
    if not _differing(found, whole):
        return "whole"
    # Of a result of two files, one alone is read by nothing; but the next run must not be stopped by it.
    return "wrong"


def _resume(known: Known, inputs: Path, folder: Path, rng: np.random.Generator) -> list[str]:
    """Go on, killed once more in half of the cases, and compare the end with the uninterrupted run."""
    verb = known.verb
    assert verb.resumes is not None
    faults = []
    if rng.random() < 0.5:
        faults += _kill(verb.resumes(inputs, folder), known.seconds * rng.random())
    code, err, _ = complete(verb.resumes(inputs, folder))
    if code != 0:
        return [*faults, f"resuming failed with {code}: {err.strip()}"]
    return faults + _left(verb, folder, known.whole)


def _again(known: Known, inputs: Path, folder: Path) -> list[str]:
    """Run the same command once more, as a user would."""
    code, err, _ = complete(known.verb.command(inputs, folder))
    if code != 0:
        return [f"the next run failed with {code}: {err.strip()}"]
    return _left(known.verb, folder, known.whole)


def _left(verb: Verb, folder: Path, whole: Digest) -> list[str]:
    """Return what differs from an uninterrupted run, and what was left over, after a command that ended well."""
    faults = [f"{name} differs" for name in _differing(verb.digest(folder), whole)]
    return faults + [f"{name} is left" for name in _litter(folder)]


def _litter(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob(".*") if path.suffix in (".tmp", ".work", ".lock"))


def _differing(found: Digest, expected: Digest) -> list[str]:
    return [name for name in sorted({*found, *expected}) if found.get(name) != expected.get(name)]
