"""Memory over a shortened day as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.load.steady import MOST, Trace, growth


def draw(sampled: Trace, rounds: Trace, cooled: Trace, path: Path) -> None:
    """Draw memory by checkpoints, by rounds and of an annealing, and the draws file below the first."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 2, figsize=(10, 5.6), layout="constrained")
    panels = (
        (axes[0, 0], sampled, "prf sample, a checkpoint a round", "checkpoints"),
        (axes[0, 1], rounds, "prf sample, rounds without a checkpoint", "rounds"),
        (axes[1, 1], cooled, "prf anneal", "rounds"),
    )
    for axis, trace, title, unit in panels:
        every = max(1, len(trace.memory) // 4000)
        axis.plot(np.arange(len(trace.memory))[::every], trace.memory[::every], color="#1f62b8", linewidth=1.0)
        axis.set(title=f"{title}: {growth(trace.memory):+.2f} MB", xlabel=unit, ylabel="resident memory, MB")
        axis.set_ylim(0.0, 1.25 * trace.memory.max())
        axis.locator_params(axis="x", nbins=6)
    axis = axes[1, 0]
    axis.plot(sampled.bytes / 1e6, color="#1f62b8", linewidth=1.0)
    axis.set(title="draws.npz, and the steps between draws", xlabel="checkpoints", ylabel="MB", ylim=(0.0, None))
    steps = axis.twinx()
    steps.semilogy(sampled.spacing, color="#d61a1c", linewidth=1.0, drawstyle="steps-post", base=2)
    steps.set_ylabel(f"steps; {MOST} draws a chain", color="#d61a1c")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
