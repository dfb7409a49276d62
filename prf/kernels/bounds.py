"""The most that beams can gain by a change of the map: what lets a proposal be rejected before all of them are asked.

The gap of a beam is what its log likelihood lacks to the highest that any distance gives. The gaps of the beams that
end on an edge are summed by edge: that is the most which they gain when the edge goes. A beam that is cut gains only
where the cut lies about its reading; elsewhere an obstacle explains the reading no better than none. Hence gaps are
summed as well over the cells in which a beam's reading lies.
"""

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core, core_entry
from prf.kernels.beams import Beams
from prf.kernels.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal

FADED = 1e-6
"""Nats: the most that a beam gains where it is cut off its reading."""
ROUNDING = 1e-6
"""Nats: more than the rounding of all sums here between two times that they are made anew."""


@core
def gap(beams: Beams, beam: int) -> float:
    """What the log likelihood of a beam lacks to its highest, nats."""
    return beams.best[beam] - beams.ray[beam, c.BEAM_LOG_LIKELIHOOD]


@core
def most_freed(beams: Beams, proposal: Proposal, level: int) -> float:
    """The most that the beams of a level on the edges that go can gain, nats."""
    most = ROUNDING
    for k in range(proposal.counts[N_OLD_EDGES]):
        most += beams.edge_gap[proposal.old_edges[k], level]
    return most


@core
def most_cut(beams: Beams, proposal: Proposal, before: int) -> float:
    """The most that the beams cut by new edges can gain, nats; `before`: lists of the levels before theirs."""
    most = 0.0
    for k in range(proposal.counts[N_NEW_EDGES]):
        for i in range(proposal.n_cells[k]):
            cell = before + proposal.cells[k, i]
            most += beams.cell_gap[cell] + FADED * beams.cell_count[cell]
    return most


@core
def shift_cells(beams: Beams, beam: int, change: float) -> None:
    """Add the change of a beam's gap to the cells in which its reading lies."""
    for slot in range(beams.aim[beam, 0], beams.aim[beam, 1]):
        beams.cell_gap[beams.slot_cell[slot]] += change


@core_entry
def find_aims(
    near: np.ndarray, far: np.ndarray, slot_start: np.ndarray, slot_exit: np.ndarray, aim: np.ndarray
) -> None:
    """Set `aim` (n, 2) to the slots, from the first to before the second, between the distances `near` and `far`."""
    for beam in range(near.shape[0]):
        first = slot_start[beam]
        last = slot_start[beam + 1]
        while first < last and slot_exit[first] < near[beam]:
            first += 1
        end = first
        while end < last and (end == first or slot_exit[end - 1] <= far[beam]):
            end += 1
        aim[beam, 0] = first
        aim[beam, 1] = end
