"""``python -m tests.verify.mutant_arm WORLDS SEED``: ranks of the laser's worlds, sampled plainly, as JSON.

Run on an altered copy of the package by ``tests.verify.controls``.
"""

from __future__ import annotations

import json
import sys

import prf
from tests.verify.sbc import run_arm, standard_arm

if __name__ == "__main__":
    found = run_arm(standard_arm("laser", "plain"), int(sys.argv[1]), int(sys.argv[2]), 1)
    lists = {"ranks": found.ranks.tolist(), "steps": found.steps.tolist(), "agreed": found.agreed.tolist()}
    print(json.dumps({"package": prf.__file__, "seconds": found.seconds, **lists}))
