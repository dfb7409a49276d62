"""Checkpoints: a resumed run repeats an uninterrupted one bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from prf.run import names
from prf.sampler.chain_state import Arrays, chain_arrays, restore
from prf.sampler.several import Sampler
from prf.sampler.stored import check_stored
from prf.shell.errors import InputError
from prf.shell.storage import damaged, load_arrays, save_arrays

SCHEMA = names.CHECKPOINT_SCHEMA


def save_checkpoint(folder: Path, sampler: Sampler, identity: str) -> None:
    """Write the state of all chains into the RUN directory `folder`; `identity` says of which run."""
    arrays: Arrays = {"run": np.array(identity)}
    for i, chain in enumerate(sampler.chains):
        arrays |= {f"chain{i}.{name}": array for name, array in chain_arrays(chain).items()}
    save_arrays(folder / names.CHECKPOINT, SCHEMA, arrays)


def load_checkpoint(folder: Path, sampler: Sampler, identity: str) -> None:
    """Put the chains of a fresh sampler into the state that was saved for the run `identity`."""
    path = folder / names.CHECKPOINT
    arrays = load_arrays(path, SCHEMA)
    if str(arrays.pop("run", "")) != identity:
        raise InputError(
            f"{path}: belongs to a run of other readings or configuration, or was written by another release. "
            "Sample anew with --force."
        )
    try:
        if "chain0.ladder.powers" in arrays:
            sampler.put_rungs()
        for i, chain in enumerate(sampler.chains):
            prefix = f"chain{i}."
            own = {name[len(prefix) :]: array for name, array in arrays.items() if name.startswith(prefix)}
            check_stored(chain_arrays(chain), own)
            restore(chain, own)
    except (KeyError, ValueError, IndexError, TypeError, OverflowError) as error:
        raise damaged(path, f"does not fit this run: {error}") from error
