"""What came of mistakes so far, in a file, so that a run goes on where another ended."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

DEFAULT = Path(__file__).resolve().parents[2] / "build" / "mutants.jsonl"


class Ledger:
    """The mistakes that some test noticed, by source.

    One that was noticed is not tried again while its source stands as it is; one that survived is, as tests may have
    come. A line of the file is a JSON object with ``module``, ``digest`` (of the source), ``mistake``, ``outcome`` and
    ``by`` (the check that noticed it).

    Parameters
    ----------
    path : Path
    anew : bool
        Whether to forget what the file holds.
    """

    def __init__(self, path: Path, *, anew: bool = False) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        if anew:
            path.unlink(missing_ok=True)

    def killed(self, module: str, source: str) -> set[str]:
        """Return the mistakes in this very source that were noticed."""
        if not self.path.exists():
            return set()
        digest = _digest(source)
        entries = [json.loads(line) for line in self.path.read_text().splitlines()]
        last = {entry["mistake"]: entry for entry in entries if (entry["module"], entry["digest"]) == (module, digest)}
        return {mistake for mistake, entry in last.items() if entry["outcome"] == "killed"}

    def note(self, module: str, source: str, mistake: str, outcome: str, by: str) -> None:
        """Add what came of a mistake."""
        entry = {"module": module, "digest": _digest(source), "mistake": mistake, "outcome": outcome, "by": by}
        with self.path.open("a") as file:
            file.write(json.dumps(entry, ensure_ascii=False) + "\n")


def _digest(source: str) -> str:
    return hashlib.sha256(source.encode()).hexdigest()[:16]
