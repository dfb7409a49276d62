"""Black area: of a map, and its change by a proposal, for a prior that prefers free space.

An edge a-b with black on its left adds -int y dx from a to b to the black area, y being measured from the level side of
the window along which the area would count too (Green's theorem); with black on its right it takes as much away.
"""

from prf.kernels import constants as c
from prf.kernels._jit import Array, core
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.geometry import inside_loop, loop_box, orientation
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import cells_of_box, walk
from prf.kernels.state.proposal import N_LOOP, N_NEW_EDGES, N_OLD_EDGES, Proposal, is_edge_removed
from prf.kernels.walls.shape import is_covered


@core
def is_between(ax: float, ay: float, bx: float, by: float, px: float, py: float, qx: float, qy: float) -> bool:
    """Whether the segment ab passes between p and q; a common end of two segments is passed by one, half open."""
    side_a = (qx - px) * (ay - py) - (qy - py) * (ax - px)
    side_b = (qx - px) * (by - py) - (qy - py) * (bx - px)
    if (side_a < 0.0) == (side_b < 0.0):
        return False
    along = ((ax - px) * (by - ay) - (ay - py) * (bx - ax)) / (side_b - side_a)
    return 0.0 < along < 1.0


@core
def passes_odd(graph: Graph, index: EdgeIndex, x: float, y: float) -> bool:
    """Whether an odd number of edges without the mark in use pass between a place and the window's centre."""
    window = graph.window
    cx = 0.5 * (window[0] + window[2])
    cy = 0.5 * (window[1] + window[3])
    odd = False
    for k in range(walk(index.grid, x, y, cx, cy, index.path)):
        cell = index.path[k]
        for place in range(index.cell_count[cell]):
            edge = index.cell_edges[cell, place]
            if index.marks[edge] != index.mark[0]:
                index.marks[edge] = index.mark[0]
                xy = graph.edge_xy[edge]
                if is_between(xy[0], xy[1], xy[2], xy[3], x, y, cx, cy):
                    odd = not odd
    return odd


@core
def is_white(graph: Graph, index: EdgeIndex, anchor_black: int, x: float, y: float, without: int) -> bool:
    """Whether a place is white: by the edges between it and the window's centre, of known colour, but for `without`.

    In a map of walls, whose anchor is NONE, it is where no wall is.
    """
    if anchor_black == c.NONE:
        return not is_covered(graph, x, y)
    index.mark[0] += 1
    if without != c.NONE:
        index.marks[without] = index.mark[0]
    return passes_odd(graph, index, x, y) == (anchor_black != 0)


@core
def sign_of(white: bool, xy: Array, window: Array) -> float:
    """1 if black lies on the left of an edge with ends `xy` (4,), -1 if on the right.

    `white`: the colour of that of its sides that faces the window's centre.
    """
    x = 0.5 * (window[0] + window[2])
    y = 0.5 * (window[1] + window[3])
    return -1.0 if white == (orientation(xy[0], xy[1], xy[2], xy[3], x, y) > 0.0) else 1.0


@core
def edge_sign(graph: Graph, index: EdgeIndex, edge: int) -> float:
    """1 if black lies on the left of an edge from its first end to its second, -1 if on the right."""
    xy = graph.edge_xy[edge]
    x = 0.5 * (xy[0] + xy[2])
    y = 0.5 * (xy[1] + xy[3])
    return sign_of(is_white(graph, index, graph.counts[c.ANCHOR_BLACK], x, y, edge), xy, graph.window)


@core
def area_below(ax: float, ay: float, bx: float, by: float, level: float) -> float:
    """-int (y - level) dx from a to b."""
    return 0.5 * (ay + by - 2.0 * level) * (ax - bx)


@core
def loop_area(loop: Array, n: int) -> float:
    """Area inside the first n rows of `loop`, positive if counter-clockwise."""
    area = 0.0
    k = n - 1
    for i in range(n):
        area += area_below(loop[k, 0], loop[k, 1], loop[i, 0], loop[i, 1], loop[0, 1])
        k = i
    return area


@core
def loop_sign(graph: Graph, index: EdgeIndex, proposal: Proposal) -> float:
    """Change of black area over the area inside the loop, if no edge lies inside it.

    An edge that goes has white on its left in the direction of the loop where the change is the signed area. Where none
    goes the loop is a triangle or a box, and the colour at one of its sides decides.
    """
    loop, n = proposal.loop, proposal.counts[N_LOOP]
    for old in range(proposal.counts[N_OLD_EDGES]):
        xy = graph.edge_xy[proposal.old_edges[old]]
        k = n - 1
        for i in range(n):
            if loop[k, 0] == xy[0] and loop[k, 1] == xy[1] and loop[i, 0] == xy[2] and loop[i, 1] == xy[3]:
                return -edge_sign(graph, index, proposal.old_edges[old])
            if loop[i, 0] == xy[0] and loop[i, 1] == xy[1] and loop[k, 0] == xy[2] and loop[k, 1] == xy[3]:
                return edge_sign(graph, index, proposal.old_edges[old])
            k = i
    xy = proposal.new_xy[0]
    x, y = 0.5 * (xy[0] + xy[2]), 0.5 * (xy[1] + xy[3])
    turns = 1.0 if loop_area(loop, n) > 0.0 else -1.0
    return turns if is_white(graph, index, graph.counts[c.ANCHOR_BLACK], x, y, c.NONE) else -turns


@core
def list_inside(graph: Graph, index: EdgeIndex, proposal: Proposal) -> int:
    """List the edges inside the loop in ``index.neighbors``, return their number."""
    loop, n = proposal.loop, proposal.counts[N_LOOP]
    x_min, y_min, x_max, y_max = loop_box(loop, n)
    i0, i1, k0, k1 = cells_of_box(index.grid, x_min, y_min, x_max, y_max)
    index.mark[0] += 1
    found = 0
    for k in range(k0, k1 + 1):
        for i in range(i0, i1 + 1):
            cell = i + index.grid.nx * k
            for place in range(index.cell_count[cell]):
                edge = index.cell_edges[cell, place]
                if index.marks[edge] == index.mark[0]:
                    continue
                index.marks[edge] = index.mark[0]
                xy = graph.edge_xy[edge]
                x, y = 0.5 * (xy[0] + xy[2]), 0.5 * (xy[1] + xy[3])
                is_near = x_min < x < x_max and y_min < y < y_max and not is_edge_removed(proposal, edge)
                if is_near and inside_loop(x, y, loop, n):
                    index.neighbors[found] = edge
                    found += 1
    return found


@core
def new_edge_sign(graph: Graph, index: EdgeIndex, proposal: Proposal, number: int) -> float:
    """:func:`edge_sign` of a new edge in the new map. It may lie on an edge that goes, one that a slide shortens."""
    window = graph.window
    cx = 0.5 * (window[0] + window[2])
    cy = 0.5 * (window[1] + window[3])
    xy = proposal.new_xy[number]
    x = 0.5 * (xy[0] + xy[2])
    y = 0.5 * (xy[1] + xy[3])
    index.mark[0] += 1
    for old in range(proposal.counts[N_OLD_EDGES]):
        index.marks[proposal.old_edges[old]] = index.mark[0]
    white = passes_odd(graph, index, x, y) == (graph.counts[c.ANCHOR_BLACK] != 0)
    if inside_loop(cx, cy, proposal.loop, proposal.counts[N_LOOP]):
        white = not white
    for k in range(proposal.counts[N_NEW_EDGES]):
        other = proposal.new_xy[k]
        if k != number and is_between(other[0], other[1], other[2], other[3], x, y, cx, cy):
            white = not white
    return sign_of(white, xy, window)


@core
def black_change(graph: Graph, index: EdgeIndex, proposal: Proposal) -> float:
    """Change of black area by a valid proposal, m2."""
    loop, n = proposal.loop, proposal.counts[N_LOOP]
    inside = list_inside(graph, index, proposal)
    if inside == 0:
        return loop_sign(graph, index, proposal) * loop_area(loop, n)
    level = graph.window[1]
    k = n - 1
    for i in range(n):
        if loop[i, 1] == graph.window[3] and loop[k, 1] == graph.window[3]:
            level = graph.window[3]
        k = i
    change = 0.0
    for number in range(inside):
        edge = index.neighbors[number]
        xy = graph.edge_xy[edge]
        change -= 2.0 * edge_sign(graph, index, edge) * area_below(xy[0], xy[1], xy[2], xy[3], level)
    for old in range(proposal.counts[N_OLD_EDGES]):
        edge = proposal.old_edges[old]
        xy = graph.edge_xy[edge]
        change -= edge_sign(graph, index, edge) * area_below(xy[0], xy[1], xy[2], xy[3], level)
    for number in range(proposal.counts[N_NEW_EDGES]):
        xy = proposal.new_xy[number]
        change += new_edge_sign(graph, index, proposal, number) * area_below(xy[0], xy[1], xy[2], xy[3], level)
    return change


@core
def black_top(graph: Graph, index: EdgeIndex, places: Array) -> float:
    """Length of the window's upper side that is black, its vertices being at `places` (capacity, 2)."""
    window, anchor = graph.window, graph.counts[c.ANCHOR_BLACK]
    length = 0.0
    if not is_white(graph, index, anchor, window[0], window[3], c.NONE):
        length -= window[0]
    if not is_white(graph, index, anchor, window[2], window[3], c.NONE):
        length += window[2]
    for i in range(graph.counts[c.BOUNDARY_VERTICES]):
        v = graph.members[c.BOUNDARY_VERTICES, i]
        if graph.vertex_side[v] == c.TOP:
            edge = graph.vertex_edges[v, 0]
            # From a vertex on top an edge leads down: on its right lies what is left of the vertex.
            downwards = 1.0 if graph.edge_vertices[edge, 0] == v else -1.0
            length -= downwards * edge_sign(graph, index, edge) * places[v, 0]
    return length


@core
def black_area(graph: Graph, index: EdgeIndex, moved: Graph) -> float:
    """Black area of a map, m2, each of its vertices displaced to where `moved` has it, all edges live ones."""
    window = graph.window
    area = (window[3] - window[1]) * black_top(graph, index, moved.vertex_xy)
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        xy = moved.edge_xy[edge]
        area += edge_sign(graph, index, edge) * area_below(xy[0], xy[1], xy[2], xy[3], window[1])
    return area
