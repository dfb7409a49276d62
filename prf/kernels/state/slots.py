"""Lists of slots by cell: which beams, or which cones, a change of the map in a cell may concern.

A slot is one cell of one reading; a cell can never list more slots than there are in it, so all room is laid out once.
What the functions take, and call ``slots``, is `Beams` or `Cones` (:mod:`prf.kernels.readings`).
"""

from typing import Any

from prf.kernels import constants as c
from prf.kernels._jit import core, spine


@core
def list_slot(slots: Any, owner: int, slot: int) -> None:
    """List a slot in its cell."""
    cell = slots.slot_cell[slot]
    place = slots.cell_count[cell]
    at = slots.cell_start[cell] + place
    slots.entries[at, 0] = owner
    slots.entries[at, 1] = slot
    slots.slot_place[slot] = place
    slots.cell_count[cell] = place + 1


@core
def unlist_slot(slots: Any, slot: int) -> None:
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


@spine
def list_from_start(slots: Any, owner: int, last: int) -> None:
    """List the slots of an owner up to `last`, none of which is listed."""
    slots.last_slot[owner] = last
    for slot in range(slots.slot_start[owner], slots.slot_start[owner + 1]):
        slots.slot_place[slot] = c.NONE
        if slot <= last:
            list_slot(slots, owner, slot)


@spine
def list_up_to(slots: Any, owner: int, last: int) -> None:
    """List the slots of an owner up to `last`, and no more."""
    old = slots.last_slot[owner]
    for slot in range(old + 1, last + 1):
        list_slot(slots, owner, slot)
    for slot in range(last + 1, old + 1):
        unlist_slot(slots, slot)
    slots.last_slot[owner] = last
