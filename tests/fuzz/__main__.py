"""Fuzz the readers of both tools: ``python -m tests.fuzz [--seconds N] [--keep FOLDER] [READER ...]``.

Every reader runs in a process of its own, which a crash of it ends. Damage is guided by coverage if atheris is
installed (``pip install atheris``). The exit code is 1 if a reader broke its promise; each such file is kept.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import traceback
from pathlib import Path

from tests.fuzz import run
from tests.fuzz.reader import Reader

BROKEN, CRASHED = 1, 3


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Fuzz the readers of both tools.")
    parser.add_argument("readers", nargs="*", metavar="READER", help="default: all")
    parser.add_argument("--seconds", type=float, default=60.0, help="of CPU time for each reader")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-finds"), help="folder for files that break a reader")
    parser.add_argument("--corpus", type=Path, help="folder for files that reached new branches, to go on from; guided")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    guiding = run.instrumented()
    with guiding or contextlib.nullcontext():
        from tests.fuzz.readers import READERS
    unknown = set(given.readers) - set(READERS)
    if unknown:
        parser.error(f"no such reader: {', '.join(sorted(unknown))}. There are {', '.join(READERS)}.")
    failed = []
    for name in given.readers or READERS:
        child = os.fork()
        if child == 0:
            try:
                fuzz_one(name, READERS[name], given, guiding is not None)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(CRASHED)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if code:
            failed.append(name)
        if code not in (0, BROKEN):
            print(f"{name}: the process ended with {code}", flush=True)
    print("failed: " + " ".join(failed) if failed else "no reader broke its promise")
    return int(bool(failed))


def fuzz_one(name: str, reader: Reader, given: argparse.Namespace, is_guided: bool) -> None:
    """Fuzz one reader, tell what came of it, and end the process."""

    def done(record: run.Record) -> None:
        os._exit(BROKEN if tell(name, record, given.keep, is_guided) else 0)

    if is_guided:
        corpus = given.corpus and given.corpus / name
        run.run_guided(reader, given.seconds, done, given.seed, corpus)
    else:
        done(run.run_plain(reader, given.seconds, given.seed))


def tell(name: str, record: run.Record, keep: Path, is_guided: bool) -> bool:
    """Print a line of JSON, keep the files that broke the reader, and return whether there are such."""
    finds = []
    for number, (place, (defect, data)) in enumerate(record.defects.items()):
        keep.mkdir(parents=True, exist_ok=True)
        file = keep / f"{name}-{number}"
        file.write_bytes(data)
        file.with_name(f"{file.name}.txt").write_text(f"{defect.what}\n{defect.trace}")
        finds.append({"place": place, "what": defect.what[:200], "file": str(file)})
    told = {"reader": name, "executions": record.executions, "cpu_s": round(record.seconds, 1), "guided": is_guided}
    print(json.dumps({**told, "defects": finds}), flush=True)
    return bool(finds)


if __name__ == "__main__":
    sys.exit(main())
