"""The figures of `step_rate` as a table for a person."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any


def table(result: dict[str, Any]) -> str:
    """Return all parts, one below the other."""
    parts = (speed(result), mix(result["equilibrium"]["moves"]), twins(result), stages(result), rivals(result))
    return "\n".join("\n".join(part) for part in parts)


def speed(result: dict[str, Any]) -> Iterator[str]:
    """Yield speed after burn-in."""
    at = result["equilibrium"]
    yield f"{result['machine']['cpu']}; one core, CPU time"
    yield f"{result['n_beams']} beams, {at['n_edges']} edges, after {result['burn_in']} steps from the empty map"
    yield ""
    span = f"{at['slowest_round']:,.0f} to {at['fastest_round']:,.0f}"
    yield f"steps per second           {at['steps_per_second']:10,.0f}   ({span})"
    yield f"accepted steps per second  {at['accepted_per_second']:10,.0f}   ({at['acceptance']:.1%} of the steps)"
    yield f"of these with a beam's impact changed  {result['share_touching']:.1%}"
    ratio = result["with_recording"]["ratio_to_bare_kernel"]
    yield f"with image and draws       {ratio:10.2f} x   the speed of the bare kernel"


def mix(moves: dict[str, dict[str, float]]) -> Iterator[str]:
    """Yield the move mix."""
    yield ""
    yield "move                       share of steps     valid  accepted  accepted if valid"
    for name, row in moves.items():
        yield (
            f"{name:26} {row['share_of_steps']:14.1%} {row['valid']:9.1%} {row['acceptance']:9.2%}"
            f" {row['acceptance_if_valid']:18.2%}"
        )


def twins(result: dict[str, Any]) -> Iterator[str]:
    """Yield the races and that both sides did the same."""
    race, check = result["twins"], result["agreement"]
    yield ""
    yield "the sampler against its twins (same maps, same random numbers, by turns)"
    for name, words in (("from_scratch", "likelihood from scratch"), ("static_index", "static index, whole beams")):
        row = race[name]
        yield (
            f"{words:26} {row['steps_per_second']:9,.0f} steps/s: the sampler is {row['ratio']:.2f} x as fast"
            f" ({row['lowest']:.2f} to {row['highest']:.2f})"
        )
    yield f"same decisions: from scratch {race['same_decisions']['scratch']}, static {race['same_decisions']['static']}"
    yield (
        f"on {check['proposals']} valid proposals: log likelihood changes differ by {check['largest_difference']:.1e}"
        f" at most; same touched beams: {check['same_touched_beams']}, {check['touched_beams_per_proposal']:.1f} each"
    )
    yield f"the dynamic index lists {race['listed_share']:.1%} of the whole beams' slots"


def stages(result: dict[str, Any]) -> Iterator[str]:
    """Yield shares of time."""
    found = result["stages"]
    yield ""
    yield "stage                       share   microseconds a step"
    for name, share in found["share"].items():
        yield f"{name:26} {share:6.1%} {found['microseconds_per_step'][name]:21.2f}"


def rivals(result: dict[str, Any]) -> Iterator[str]:
    """Yield (h) against (i) and (e) against (j)."""
    found = result["rivals"]
    for run in found["runs"]:
        yield ""
        yield f"{found['source']}: {found['n_beams']} beams, {min(run['n_edges'])} to {max(run['n_edges'])} edges"
        yield f"(e) displaces by {run['move_reach']:.2f} m, median  proposed     valid  accepted  accepted if valid"
        for name, row in run["moves"].items():
            yield (
                f"{name:26} {row['proposed']:16,} {row['valid']:9.1%} {row['acceptance']:9.3%}"
                f" {row['acceptance_if_valid']:18.2%}"
            )
