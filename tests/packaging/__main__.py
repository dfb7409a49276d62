"""``python -m tests.packaging``: install the wheel, nothing else, and run the main jobs of both tools with it.

Once with the newest versions that there are of what it needs, once with the oldest that pyproject.toml allows.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.packaging.archives import build
from tests.packaging.bare import JOBS, MISSING, fault_of_job, fault_of_missing, make_bare
from tests.packaging.bounds import MINIMUM

VERSIONS: dict[str, Path | None] = {"newest": None, "oldest": MINIMUM}


def main() -> int:
    """Print a line a command; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", default=sys.executable, help="interpreter of the environments")
    parser.add_argument("--versions", choices=list(VERSIONS), action="append", help="only these, repeatable")
    asked = parser.parse_args()
    n_faults = 0
    with tempfile.TemporaryDirectory() as folder:
        archives = build(Path(folder) / "dist")
        for archive in archives:
            print(f"{archive.name}: {archive.stat().st_size / 1e6:.1f} MB")
        for versions in asked.versions or VERSIONS:
            n_faults += try_versions(versions, Path(folder) / versions, asked.python, archives.wheel)
    return int(n_faults > 0)


def try_versions(versions: str, folder: Path, python: str, wheel: Path) -> int:
    """Run all jobs with these versions of what the wheel needs; return how many were wrong."""
    folder.mkdir()
    bare = make_bare(folder, python, wheel, VERSIONS[versions])
    jobs = [(command, fault_of_job(bare, command)) for command in JOBS]
    refused = [(case.command, fault_of_missing(bare, case)) for case in MISSING]
    for kind, outcomes in (("runs", jobs), ("names its extra", refused)):
        for command, fault in outcomes:
            print(f"{versions}: {fault or kind}: {command}", flush=True)
    return sum(fault is not None for _, fault in [*jobs, *refused])


if __name__ == "__main__":
    sys.exit(main())
