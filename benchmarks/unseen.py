"""`mapq` on real maps that no model was trained on."""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks import real_data
from benchmarks.unseen_sets import prepare


def main() -> None:
    """Prepare or score."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("verb", choices=("prepare", "score"))
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--data", type=Path, default=real_data.DATA, help="folder with the public scans")
    options = parser.parse_args()
    prepare(options.data, options.cache, lambda line: print(line, flush=True))


if __name__ == "__main__":
    main()
