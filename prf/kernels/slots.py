"""Lists of slots by cell: which beams, or which cones, a change of the map in a cell may concern.

A slot is one cell of one reading; a cell can never list more slots than there are in it, so all room is laid out once.
"""

from typing import Protocol

from prf.kernels import constants as c
from prf.kernels._jit import Array, core


class Slots(Protocol):
    """The arrays that beams and cones have in common."""

    @property
    def slot_cell(self) -> Array:
        """(slots,) i4."""

    @property
    def slot_place(self) -> Array:
        """(slots,) i4 place in the cell's list, NONE while not listed."""

    @property
    def cell_start(self) -> Array:
        """(n_cells + 1,) i8."""

    @property
    def cell_count(self) -> Array:
        """(n_cells,) i4."""

    @property
    def entries(self) -> Array:
        """(slots, 2) i4 owner and slot, listed by cell."""


@core
def list_slot(slots: Slots, owner: int, slot: int) -> None:
    """List a slot in its cell."""
    cell = slots.slot_cell[slot]
    place = slots.cell_count[cell]
    at = slots.cell_start[cell] + place
    slots.entries[at, 0] = owner
    slots.entries[at, 1] = slot
    slots.slot_place[slot] = place
    slots.cell_count[cell] = place + 1


@core
def unlist_slot(slots: Slots, slot: int) -> None:
    """Remove a slot from its cell's list by moving the last entry into its place."""
    cell = slots.slot_cell[slot]
    place = slots.slot_place[slot]
    last = slots.cell_count[cell] - 1
    start = slots.cell_start[cell]
    moved = slots.entries[start + last, 1]
    slots.entries[start + place, 0] = slots.entries[start + last, 0]
    slots.entries[start + place, 1] = moved
    slots.slot_place[moved] = place
    slots.slot_place[slot] = c.NONE
    slots.cell_count[cell] = last
