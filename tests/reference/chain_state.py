"""What slots, sets and stacks of a chain must satisfy beyond what `recompute` compares, in plain Python."""

from __future__ import annotations

import hashlib

import numpy as np

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain


def structural_faults(chain: Chain) -> list[str]:
    """Names of what does not hold: cross references of slots, members of the sets one by one, free stacks."""
    graph = chain.graph
    members = [graph.members[kind, : graph.counts[kind]].tolist() for kind in range(c.N_SETS)]
    edges, interior, boundary = (set(members[kind]) for kind in (c.EDGES, c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES))
    vertices = interior | boundary
    ends = {e: tuple(graph.edge_vertices[e].tolist()) for e in edges}
    at: dict[int, set[int]] = {v: set() for v in vertices}
    for e, (a, b) in ends.items():
        at[a].add(e)
        at[b].add(e)
    side = {v: int(graph.vertex_side[v]) for v in vertices}
    neighbors = {v: {a + b - v for a, b in (ends[e] for e in at[v])} for v in vertices}
    triangles = {v for v in interior if any(neighbors[u] & neighbors[v] for u in neighbors[v])}
    apexes = {v for v in interior if len({side[u] for u in neighbors[v]}) == 1 and not neighbors[v] & interior}
    cuts = {e for e, (a, b) in ends.items() if c.INTERIOR not in (side[a], side[b]) and (side[a] - side[b]) % 2}
    free_v = graph.free_vertices[: graph.counts[c.FREE_VERTICES]].tolist()
    free_e = graph.free_edges[: graph.counts[c.FREE_EDGES]].tolist()
    capacity = set(range(len(graph.edge_length)))
    holds = {
        "edges at vertices": all(
            {e for e in graph.vertex_edges[v].tolist() if e != c.NONE} == at[v] and graph.vertex_edges[v, 0] != c.NONE
            for v in vertices
        ),
        "ends of edges": all(
            graph.edge_xy[e].tolist() == [*graph.vertex_xy[a].tolist(), *graph.vertex_xy[b].tolist()]
            for e, (a, b) in ends.items()
        ),
        "triangle vertices": set(members[c.TRIANGLE_VERTICES]) == triangles,
        "boundary apexes": set(members[c.BOUNDARY_APEXES]) == apexes,
        "corner cuts": set(members[c.CORNER_CUTS]) == cuts,
        "positions": all(
            {slot: place for slot, place in enumerate(graph.positions[kind].tolist()) if place != c.NONE}
            == {slot: place for place, slot in enumerate(members[kind])}
            for kind in range(c.N_SETS)
        ),
        "free vertices": len(free_v) == len(set(free_v)) and set(free_v) == capacity - vertices,
        "free edges": len(free_e) == len(set(free_e)) and set(free_e) == capacity - edges,
    }
    return [name for name, held in holds.items() if not held]


def digest(chain: Chain, rng: np.random.Generator) -> dict[str, str]:
    """Digest of everything that decides how a chain goes on, by part; the room of its arrays does not."""
    graph, n = chain.graph, chain.graph.counts
    slots = np.concatenate([graph.members[k, : n[k]] for k in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES)])
    edges = graph.members[c.EDGES, : n[c.EDGES]]
    parts = {
        "counts": n[[k for k in range(c.N_COUNTS) if k not in (c.FREE_VERTICES, c.FREE_EDGES, c.NEEDS_ROOM)]],
        "sums": graph.sums,
        "vertices": np.concatenate(
            [graph.vertex_xy[slots].ravel(), graph.vertex_sine[slots], graph.vertex_side[slots]]
        ),
        "edges": np.concatenate([graph.edge_vertices[edges].ravel(), edges]),
        "members": np.concatenate([graph.members[k, : n[k]] for k in range(c.N_SETS)]),
        "beams": np.concatenate([chain.beams.ray.ravel(), chain.beams.impact_edge, chain.beams.next_beam]),
        "cones": np.concatenate([chain.cones.pose.ravel(), chain.cones.last_slot, chain.cones.slot_place]),
        "points": chain.points.column,
        "index": np.concatenate(
            [row[:m] for row, m in zip(chain.edge_index.cell_edges, chain.edge_index.cell_count, strict=True)]
        ),
        "image": image_state(chain),
        "outcomes": chain.outcomes,
    }
    found = {
        name: hashlib.sha256(np.ascontiguousarray(part).tobytes()).hexdigest()[:16] for name, part in parts.items()
    }
    found["generator"] = hashlib.sha256(repr(rng.bit_generator.state).encode()).hexdigest()[:16]
    return found


def image_state(chain: Chain) -> np.ndarray:
    """Colours, counts and times of the pixels, the times up to the present step whenever they were last added up."""
    image, step = chain.image, int(chain.graph.counts[c.STEP])
    black = image.black_time + (image.black != 0) * (step - image.black_since)
    mixed = image.mixed_time + ((image.black != 0) | (image.n_edges > 0)) * (step - image.mixed_since)
    return np.concatenate([image.black, image.n_edges, black, mixed])
