"use strict";
// Draws in the order of chains, and the exact answers of each; numbers are packed as prf/output/report/embedded.py says.
const Prf = {};

// Whole numbers from their bytes, all lowest ones first.
Prf.whole = (buffer) => {
  const bytes = new Uint8Array(buffer),
    n = bytes.length / 4,
    found = new Int32Array(n);
  for (let i = 0; i < n; i++)
    found[i] = bytes[i] | (bytes[n + i] << 8) | (bytes[2 * n + i] << 16) | (bytes[3 * n + i] << 24);
  return found;
};

Prf.Draws = class {
  // window: [x0, y0, x1, y1] in metres; step: metres of a coordinate.
  constructor(head, buffer, window, step) {
    const numbers = Prf.whole(buffer);
    let place = 0;
    const take = (n) => numbers.subarray(place, (place += n)),
      sum = (column) => column.forEach((value, i) => (column[i] = value + (i ? column[i - 1] : 0))) || column;
    Object.assign(this, { window, step, n: head.step.length, starts: head.starts, chains: head.chains });
    Object.assign(this, { steps: head.step, cornerBlack: head.corner_black, smallestEss: head.smallest_ess });
    Object.assign(this, { probes: head.probes, near: head.near });
    this.x = sum(take(head.n_vertices));
    this.y = take(head.n_vertices);
    this.a = sum(take(head.n_edges));
    this.b = take(head.n_edges).map((value, e) => value + this.a[e]);
    this.first = take(head.n_edges);
    this.last = take(head.n_edges).map((value, e) => value + this.first[e]);
    this.size = [0, 1].map((axis) => Math.round((window[axis + 2] - window[axis]) / step));
  }
  chainOf(draw) {
    return this.starts.findIndex((start, i) => draw >= start && draw < this.starts[i + 1]);
  }
  inside([x, y]) {
    const [x0, y0, x1, y1] = this.window;
    return x >= x0 && x <= x1 && y >= y0 && y <= y1;
  }
  local([x, y]) {
    return [(x - this.window[0]) / this.step, (y - this.window[1]) / this.step];
  }
  // Whether each draw (n,) is black at a point: the colour of the window's lower left corner, switched by every edge
  // below the point within its half-open span, and by every vertex on the lower side up to it (prf/kernels/state/colours.py).
  blackAt(point) {
    const { x, y, a, b, first, last } = this,
      turns = new Uint8Array(this.n + 1);
    let [px, py] = this.local(point);
    px = Math.min(px, this.size[0] - 1e-6);
    for (let e = 0; e < a.length; e++) {
      // Vertices are sorted by x, so that a is the left end.
      const ax = x[a[e]],
        bx = x[b[e]];
      if (ax > px) break;
      let odd = px < bx && (bx - ax) * (py - y[a[e]]) - (y[b[e]] - y[a[e]]) * (px - ax) > 0;
      odd ^= y[a[e]] === 0;
      odd ^= y[b[e]] === 0 && bx <= px;
      if (odd) {
        turns[first[e]] ^= 1;
        turns[last[e]] ^= 1;
      }
    }
    let odd = 0;
    return turns.subarray(0, this.n).map((turn, draw) => (odd ^= turn) ^ this.cornerBlack[draw]);
  }
  // Whether in each draw (n,) a disc can follow the path: its start is white and no edge comes within the radius.
  clearAlong(path, radius) {
    const corners = (path.length > 1 ? path : [path[0], path[0]]).map((point) => this.local(point)),
      reach = radius / this.step,
      blocked = new Int32Array(this.n + 1),
      { x, y, a, b, first, last } = this;
    for (let e = 0; e < a.length; e++) {
      const [ax, ay, bx, by] = [x[a[e]], y[a[e]], x[b[e]], y[b[e]]];
      for (let i = 1; i < corners.length; i++) {
        const [[cx, cy], [dx, dy]] = [corners[i - 1], corners[i]];
        if (bx < Math.min(cx, dx) - reach || ax > Math.max(cx, dx) + reach) continue;
        if (Math.max(ay, by) < Math.min(cy, dy) - reach || Math.min(ay, by) > Math.max(cy, dy) + reach) continue;
        if (Prf.distance2(ax, ay, bx, by, cx, cy, dx, dy) > reach * reach) continue;
        blocked[first[e]] += 1;
        blocked[last[e]] -= 1;
        break;
      }
    }
    let near = 0;
    return this.blackAt(path[0]).map((black, draw) => +((near += blocked[draw]) === 0 && !black));
  }
  // The smallest effective sample size of the probes near a point or path, as prf/results/estimate.py has it.
  essNear(path, radius) {
    const reach2 = (this.near + radius) ** 2,
      legs = path.map((point, i) => [...path[Math.max(i - 1, 0)], ...point]),
      isNear = ([x, y]) => legs.some((leg) => Prf.distance2(x, y, x, y, ...leg) <= reach2),
      found = this.probes.filter(isNear).map((probe) => probe[2]);
    return found.length ? Math.min(...found) : this.smallestEss;
  }
  // The black area of a draw as a path in steps, for the even-odd rule: what is above each edge and right of each vertex
  // on the lower side changes colour, and so does the whole window if its corner is black.
  area(draw) {
    const { x, y, a, b } = this,
      [wide, high] = this.size,
      path = new Path2D();
    if (this.cornerBlack[draw]) path.rect(0, 0, wide, high);
    for (let e = 0; e < a.length; e++) {
      if (this.first[e] > draw || draw >= this.last[e]) continue;
      for (const v of [a[e], b[e]]) if (y[v] === 0) path.rect(x[v], 0, wide - x[v], high);
      path.moveTo(x[a[e]], high);
      for (const v of [a[e], b[e]]) path.lineTo(x[v], y[v]);
      path.lineTo(x[b[e]], high);
      path.closePath();
    }
    return path;
  }
};

// Squared distance of two segments, 0 where they meet.
Prf.distance2 = (ax, ay, bx, by, cx, cy, dx, dy) => {
  const side = (px, py, qx, qy, rx, ry) => (qx - px) * (ry - py) - (qy - py) * (rx - px),
    apart = (p, q) => (p > 0 && q < 0) || (p < 0 && q > 0);
  if (
    apart(side(ax, ay, bx, by, cx, cy), side(ax, ay, bx, by, dx, dy)) &&
    apart(side(cx, cy, dx, dy, ax, ay), side(cx, cy, dx, dy, bx, by))
  )
    return 0;
  const toSegment = (px, py, qx, qy, rx, ry) => {
    const [ux, uy] = [rx - qx, ry - qy],
      length2 = ux * ux + uy * uy,
      t = length2 ? Math.min(1, Math.max(0, ((px - qx) * ux + (py - qy) * uy) / length2)) : 0;
    return (px - qx - t * ux) ** 2 + (py - qy - t * uy) ** 2;
  };
  return Math.min(
    toSegment(ax, ay, cx, cy, dx, dy),
    toSegment(bx, by, cx, cy, dx, dy),
    toSegment(cx, cy, ax, ay, bx, by),
    toSegment(dx, dy, ax, ay, bx, by),
  );
};
