"use strict";
// The views that the report and the labelling page share: a plan on a canvas, and the map in space drawn by plotly.
const Views = (() => {
  const PALETTES = {
    "blue-red": { plausible: [[176, 203, 235], [22, 82, 164]], suspicious: [[247, 178, 164], [205, 20, 24]] },
    "colour-blind": { plausible: [[158, 196, 226], [0, 74, 136]], suspicious: [[253, 217, 142], [214, 120, 0]] },
  };
  const LOOSE = [198, 203, 207], INK = "#1b2126", SOFT = "#566069";
  const MARK = { points: [17, 17, 17], line: [240, 160, 0] };
  const EYE = { x: 0.6, y: -1.05, z: 0.8 };
  const mix = (a, b, t) => a.map((value, i) => Math.round(value + (b[i] - value) * t));
  const css = (rgb) => `rgb(${rgb[0]},${rgb[1]},${rgb[2]})`;

  async function unpack(id) {
    const text = document.getElementById(id).textContent.trim();
    return gunzip(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
  }
  async function gunzip(bytes) {
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }

  // Points and outlines, patch after patch; the numbers are those of mapq/report/scene.py.
  class Scene {
    constructor(head, buffer) {
      let place = 0;
      const take = (n) => { place += n; return new Int32Array(buffer, 4 * (place - n), n); };
      const metres = (axis) => (n) => Float32Array.from(take(n), (value) => value * head.step + head.low[axis]);
      const columns = (n) => [0, 1, 2].map((axis) => metres(axis)(n));
      this.m = head.m;
      this.points = columns(head.k);
      this.start = take(head.m + 2);
      this.corners = columns(head.h);
      this.cornerStart = take(head.m + 1);
      this.low = head.low;
      this.high = head.high;
    }
    patchOf(point) {
      let low = 0, high = this.m;
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (this.start[middle] <= point) low = middle; else high = middle - 1;
      }
      return point >= this.start[this.m] ? -1 : low;
    }
    ownerOf(corner) {
      let low = 0, high = this.m - 1;
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (this.cornerStart[middle] <= corner) low = middle; else high = middle - 1;
      }
      return low;
    }
    boxOf(patches) {
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      for (const patch of patches) {
        for (const [columns, start] of [[this.points, this.start], [this.corners, this.cornerStart]]) {
          for (let i = start[patch]; i < start[patch + 1]; i++) {
            for (let axis = 0; axis < 3; axis++) {
              low[axis] = Math.min(low[axis], columns[axis][i]);
              high[axis] = Math.max(high[axis], columns[axis][i]);
            }
          }
        }
      }
      return low[0] <= high[0] ? [low, high] : [this.low, this.high];
    }
  }

  // Writes squares of pixels; with depths the nearest stays.
  class Raster {
    constructor(wide, high, withDepth) {
      this.wide = wide; this.high = high;
      this.image = new ImageData(wide, high);
      this.pixels = new Uint32Array(this.image.data.buffer);
      this.depth = withDepth ? new Float32Array(wide * high).fill(-Infinity) : null;
      this.pixels.fill(0xffffffff);
    }
    dot(x, y, size, colour, depth) {
      const left = Math.max(0, Math.round(x - size / 2)), right = Math.min(this.wide, Math.round(x + size / 2) || 1);
      const top = Math.max(0, Math.round(y - size / 2)), bottom = Math.min(this.high, Math.round(y + size / 2) || 1);
      for (let row = top; row < bottom; row++) {
        for (let i = row * this.wide + left; i < row * this.wide + right; i++) {
          if (this.depth) { if (this.depth[i] >= depth) continue; this.depth[i] = depth; }
          this.pixels[i] = colour;
        }
      }
    }
  }
  const packedColour = (rgb) => (255 << 24) | (rgb[2] << 16) | (rgb[1] << 8) | rgb[0];

  // look: { colour(patch) -> rgb, rank(patch) -> higher is drawn later, selected: number, points, outlines: bool }
  class Plan {
    constructor(canvas, scene, look, onPick) {
      Object.assign(this, { canvas, scene, look, onPick, density: window.devicePixelRatio || 1 });
      this.groups = [...Array(scene.m).keys()].sort((a, b) => look.rank(a) - look.rank(b));
      this.show();
      new ResizeObserver(() => this.draw()).observe(canvas);
      this.listen();
    }
    show(box) {
      this.fitted = { box };
      const [low, high] = box || [this.scene.low, this.scene.high];
      const [wide, tall] = this.size();
      const margin = box ? marginOf(low, high) : 0;
      this.scale = Math.min((wide - 50) / Math.max(high[0] - low[0] + 2 * margin, 1), (tall - 40) / Math.max(high[1] - low[1] + 2 * margin, 1));
      this.middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
      this.draw();
    }
    size() { return this.paper || [this.canvas.clientWidth, this.canvas.clientHeight]; }
    toPixel(x, y) {
      const d = this.density;
      return [this.canvas.width / 2 + (x - this.middle[0]) * this.scale * d, this.canvas.height / 2 - (y - this.middle[1]) * this.scale * d];
    }
    draw() {
      const canvas = this.canvas, [wide, tall] = this.size().map((length) => Math.round(length * this.density));
      if (!wide || !tall || !this.scale) return;
      canvas.width = wide; canvas.height = tall;
      const raster = new Raster(wide, tall, false), size = this.dotSize();
      if (this.look.points) {
        this.drawPoints(raster, this.scene.m, this.look.loose || LOOSE, Math.max(1, 0.8 * size));
        for (const patch of this.groups) this.drawPoints(raster, patch, this.look.colour(patch), size);
      }
      const pen = canvas.getContext("2d");
      pen.putImageData(raster.image, 0, 0);
      if (this.look.outlines) this.drawOutlines(pen);
      if (this.look.selected >= 0) this.drawSelected(pen, size);
      this.drawFrame(pen);
    }
    dotSize() { return Math.min(6, Math.max(1, 0.05 * this.scale)) * this.density; }
    drawPoints(raster, patch, rgb, size) {
      const [x, y] = this.scene.points, colour = packedColour(rgb), factor = this.scale * this.density;
      const left = this.canvas.width / 2 - this.middle[0] * factor, top = this.canvas.height / 2 + this.middle[1] * factor;
      for (let i = this.scene.start[patch]; i < this.scene.start[patch + 1]; i++) {
        raster.dot(left + x[i] * factor, top - y[i] * factor, size, colour, 0);
      }
    }
    path(pen, patch) {
      const [x, y] = this.scene.corners;
      pen.beginPath();
      for (let i = this.scene.cornerStart[patch]; i < this.scene.cornerStart[patch + 1]; i++) pen.lineTo(...this.toPixel(x[i], y[i]));
      pen.closePath();
    }
    drawOutlines(pen) {
      pen.lineWidth = this.density;
      pen.lineJoin = "round";
      for (const patch of this.groups) {
        if (this.scene.cornerStart[patch + 1] === this.scene.cornerStart[patch]) continue;
        this.path(pen, patch);
        pen.fillStyle = pen.strokeStyle = css(this.look.colour(patch));
        pen.globalAlpha = 0.16; pen.fill();
        pen.globalAlpha = 0.9; pen.stroke();
      }
      pen.globalAlpha = 1;
    }
    drawSelected(pen, size) {
      const patch = this.look.selected, [x, y] = this.scene.points;
      const mark = this.look.mark || MARK;
      pen.fillStyle = css(mark.points);
      for (let i = this.scene.start[patch]; i < this.scene.start[patch + 1]; i++) {
        const [px, py] = this.toPixel(x[i], y[i]);
        pen.fillRect(px - size * 0.6, py - size * 0.6, size * 1.2, size * 1.2);
      }
      this.path(pen, patch);
      for (const [width, style] of [[7, "#fff"], [4.5, css(mark.line)], [1.5, css(mark.points)]]) {
        pen.lineWidth = width * this.density; pen.strokeStyle = style; pen.stroke();
      }
    }
    drawFrame(pen) {
      const d = this.density, step = niceStep(90 / this.scale), wide = this.canvas.width, tall = this.canvas.height;
      pen.font = `${11 * d}px system-ui, sans-serif`;
      pen.textBaseline = "alphabetic";
      const label = (text, x, y) => {
        pen.lineWidth = 3 * d; pen.strokeStyle = "#fff"; pen.strokeText(text, x, y);
        pen.fillStyle = SOFT; pen.fillText(text, x, y);
      };
      const from = (axis, pixels) => this.middle[axis] - pixels / 2 / this.scale / d;
      for (let x = Math.ceil(from(0, wide) / step) * step; x < from(0, -wide); x += step) {
        const px = this.toPixel(x, 0)[0];
        pen.fillStyle = SOFT; pen.fillRect(px, tall - 5 * d, d, 5 * d);
        label(+x.toPrecision(8) + "", px + 3 * d, tall - 4 * d);
      }
      for (let y = Math.ceil(from(1, tall) / step) * step; y < from(1, -tall); y += step) {
        const py = this.toPixel(0, y)[1];
        pen.fillStyle = SOFT; pen.fillRect(0, py, 5 * d, d);
        label(+y.toPrecision(8) + "", 7 * d, py + 4 * d);
      }
      const bar = niceStep(60 / this.scale), long = bar * this.scale * d, right = wide - 14 * d, y = 16 * d;
      pen.fillStyle = INK; pen.fillRect(right - long, y, long, 3 * d);
      label(`${bar} m`, right - long, y - 4 * d);
    }
    pick(event) {
      const bounds = this.canvas.getBoundingClientRect(), d = this.density, [x, y] = this.scene.points;
      const px = (event.clientX - bounds.left) * d, py = (event.clientY - bounds.top) * d, reach = (9 * d) ** 2;
      let best = -1, least = Infinity;
      for (let i = 0; i < this.scene.start[this.scene.m]; i++) {
        const [qx, qy] = this.toPixel(x[i], y[i]), far = (qx - px) ** 2 + (qy - py) ** 2;
        if (far > reach) continue;
        const patch = this.scene.patchOf(i), cost = far - 4 * d * d * this.look.rank(patch);
        if (cost < least) { least = cost; best = patch; }
      }
      return best;
    }
    zoom(factor, px, py) {
      this.fitted = null;
      const x = this.middle[0] + (px - this.canvas.clientWidth / 2) / this.scale, y = this.middle[1] - (py - this.canvas.clientHeight / 2) / this.scale;
      this.scale = Math.min(2000, Math.max(1e-3, this.scale * factor));
      this.middle = [x - (px - this.canvas.clientWidth / 2) / this.scale, y + (py - this.canvas.clientHeight / 2) / this.scale];
      this.soon();
    }
    move(dx, dy) { this.fitted = null; this.middle[0] -= dx / this.scale; this.middle[1] += dy / this.scale; this.soon(); }
    soon() {
      if (this.waiting) return;
      this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.draw(); });
    }
    listen() {
      const canvas = this.canvas;
      let last = null, moved = 0;
      canvas.addEventListener("wheel", (event) => {
        event.preventDefault();
        this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
      }, { passive: false });
      canvas.addEventListener("pointerdown", (event) => { last = [event.clientX, event.clientY]; moved = 0; canvas.setPointerCapture(event.pointerId); });
      canvas.addEventListener("pointermove", (event) => {
        if (!last) return;
        const dx = event.clientX - last[0], dy = event.clientY - last[1];
        moved += Math.abs(dx) + Math.abs(dy);
        last = [event.clientX, event.clientY];
        this.move(dx, dy);
      });
      canvas.addEventListener("pointerup", (event) => {
        if (last && moved < 5) { const patch = this.pick(event); if (patch >= 0) this.onPick(patch); }
        last = null;
      });
      canvas.addEventListener("pointercancel", () => { last = null; });
      canvas.addEventListener("keydown", (event) => {
        const step = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] }[event.key];
        if (step) this.move(...step);
        else if (event.key === "+" || event.key === "=") this.zoom(1.3, canvas.clientWidth / 2, canvas.clientHeight / 2);
        else if (event.key === "-") this.zoom(1 / 1.3, canvas.clientWidth / 2, canvas.clientHeight / 2);
        else return;
        event.preventDefault();
        event.stopPropagation();
      });
    }
  }

  // Metres shown around a box.
  const marginOf = (low, high) => Math.max(2, 0.3 * Math.max(...high.map((value, axis) => value - low[axis])));

  function niceStep(least) {
    const power = 10 ** Math.floor(Math.log10(least));
    return [1, 2, 5, 10].map((factor) => +(factor * power).toPrecision(3)).find((step) => step >= least * 0.999);
  }

  function hasWebGL() {
    try {
      const context = document.createElement("canvas").getContext("webgl");
      if (context) context.getExtension("WEBGL_lose_context")?.loseContext();
      return !!context;
    } catch { return false; }
  }

  // The map in space. Each trace has one colour scale from 0 to 1, cut at the middle where the label changes.
  class Space {
    constructor(element, scene, look, onPick) {
      Object.assign(this, { element, scene, look, onPick, works: hasWebGL() });
      if (!this.works) return;
      const config = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["toImage", "tableRotation", "resetCameraLastSave3d"], scrollZoom: true };
      Plotly.newPlot(element, this.traces(), this.layout(), config);
      // A click of plotly's own needs the button to be held for a frame: what lies under the pointer is known before.
      let under = -1, from = null;
      element.on("plotly_hover", (event) => { under = this.patchOf(event.points[0]); });
      element.on("plotly_unhover", () => { under = -1; });
      element.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; }, true);
      element.addEventListener("pointerup", (event) => {
        const still = from && Math.hypot(event.clientX - from[0], event.clientY - from[1]) < 4;
        from = null;
        if (still && under >= 0 && under < this.scene.m && !event.target.closest?.(".modebar")) this.onPick(under);
      }, true);
    }
    patchOf(point) {
      return point.curveNumber === 1 ? this.scene.patchOf(point.pointNumber) : point.curveNumber === 2 ? this.scene.ownerOf(point.pointNumber) : -1;
    }
    layout() {
      const axis = (title) => ({ title: { text: title }, backgroundcolor: "#fff", gridcolor: "#e4e8ea", zeroline: false, showspikes: false, color: SOFT });
      const { x, y, z, aspectratio } = this.frame();
      return {
        margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, hovermode: "closest", paper_bgcolor: "#fff", uirevision: "stay",
        scene: { aspectmode: "manual", aspectratio, xaxis: { ...axis("x"), range: x }, yaxis: { ...axis("y"), range: y }, zaxis: { ...axis("z"), range: z, nticks: 4 }, camera: { eye: this.look.eye || EYE }, dragmode: "orbit" },
      };
    }
    // What a box needs of the three axes: ranges, and lengths that keep metres alike, the longest 1.
    frame(box) {
      const [low, high] = box || [this.scene.low, this.scene.high], margin = box ? marginOf(low, high) : 1;
      const ranges = low.map((value, axis) => [value - margin, high[axis] + margin]), lengths = ranges.map(([a, b]) => b - a);
      const most = Math.max(...lengths);
      return { x: ranges[0], y: ranges[1], z: ranges[2], aspectratio: { x: lengths[0] / most, y: lengths[1] / most, z: lengths[2] / most } };
    }
    scale() {
      const steps = this.look.scale();
      return steps.map(([at, rgb]) => [at, css(rgb)]);
    }
    cut(columns, from, to) { return { x: columns[0].subarray(from, to), y: columns[1].subarray(from, to), z: columns[2].subarray(from, to) }; }
    traces() {
      const { scene, look } = this, inside = scene.start[scene.m], all = scene.start[scene.m + 1];
      const value = new Float32Array(inside), size = look.dot || 2;
      for (let patch = 0; patch < scene.m; patch++) value.fill(look.value(patch), scene.start[patch], scene.start[patch + 1]);
      const colours = { cmin: 0, cmax: 1, colorscale: this.scale(), showscale: false };
      return [
        { type: "scatter3d", mode: "markers", hoverinfo: "skip", visible: !!look.points, ...this.cut(scene.points, inside, all), marker: { size: 1.2, color: css(look.loose || LOOSE), line: { width: 0 } } },
        { type: "scatter3d", mode: "markers", visible: !!look.points, ...this.cut(scene.points, 0, inside), marker: { size, color: value, line: { width: 0 }, ...colours }, hovertemplate: "%{x:.2f}, %{y:.2f}, %{z:.2f}<extra></extra>" },
        { ...this.mesh(colours), visible: !!look.outlines },
        ...this.selection(),
      ];
    }
    mesh(colours) {
      const { scene, look } = this, i = [], j = [], k = [], intensity = [];
      for (let patch = 0; patch < scene.m; patch++) {
        const first = scene.cornerStart[patch], last = scene.cornerStart[patch + 1];
        for (let corner = first + 1; corner + 1 < last; corner++) { i.push(first); j.push(corner); k.push(corner + 1); intensity.push(look.value(patch)); }
      }
      return {
        type: "mesh3d", ...this.cut(scene.corners, 0, scene.corners[0].length), i, j, k, intensity, intensitymode: "cell", opacity: look.opacity ?? 0.55, flatshading: true, hoverinfo: "none",
        lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 }, ...colours,
      };
    }
    selection() {
      const { scene, look } = this, patch = look.selected, mark = look.mark || MARK;
      const points = patch < 0 ? this.cut(scene.points, 0, 0) : this.cut(scene.points, scene.start[patch], scene.start[patch + 1]);
      const ring = [[], [], []];
      if (patch >= 0) {
        const first = scene.cornerStart[patch], last = scene.cornerStart[patch + 1];
        for (let corner = first; corner <= last && last > first; corner++) ring.forEach((axis, n) => axis.push(scene.corners[n][corner < last ? corner : first]));
      }
      return [
        { type: "scatter3d", mode: "markers", hoverinfo: "skip", ...points, marker: { size: (look.dot || 2) + 1, color: css(mark.points), line: { width: 0 } } },
        { type: "scatter3d", mode: "lines", hoverinfo: "skip", x: ring[0], y: ring[1], z: ring[2], line: { color: css(mark.line), width: 9 } },
      ];
    }
    select() {
      if (!this.works) return;
      const traces = this.selection();
      const update = { x: [], y: [], z: [] };
      for (const trace of traces) for (const axis of ["x", "y", "z"]) update[axis].push(trace[axis]);
      Plotly.restyle(this.element, update, [3, 4]);
    }
    refresh() {
      if (this.works) Plotly.react(this.element, this.traces(), { ...this.element.layout, uirevision: "stay" });
    }
    show(box) {
      if (!this.works) return;
      const { x, y, z, aspectratio } = this.frame(box);
      const update = { "scene.xaxis.range": x, "scene.yaxis.range": y, "scene.zaxis.range": z, "scene.aspectratio": aspectratio, "scene.camera.eye": this.look.eye || EYE };
      Plotly.relayout(this.element, update);
    }
    eye() {
      return (this.works && this.element._fullLayout?.scene?.camera?.eye) || this.look.eye || EYE;
    }
    close() { if (this.works) Plotly.purge(this.element); }
  }

  // The map in space without WebGL, and for paper: points projected along the eye's line of sight.
  function drawFlat(canvas, scene, look, eye, density, paper) {
    const [wide, tall] = (paper || [canvas.clientWidth, canvas.clientHeight]).map((length) => Math.round(length * density));
    if (!wide || !tall) return;
    const flat = Math.hypot(eye.x, eye.y) || 1e-9, length = Math.hypot(flat, eye.z);
    const right = [-eye.y / flat, eye.x / flat, 0], toEye = [eye.x / length, eye.y / length, eye.z / length];
    const up = [-toEye[2] * right[1], toEye[2] * right[0], toEye[0] * right[1] - toEye[1] * right[0]];
    const middle = [0, 1, 2].map((axis) => (scene.low[axis] + scene.high[axis]) / 2);
    const along = (vector, x, y, z) => vector[0] * (x - middle[0]) + vector[1] * (y - middle[1]) + vector[2] * (z - middle[2]);
    const [xs, ys, zs] = scene.points, inside = scene.start[scene.m] || xs.length;
    const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (let i = 0; i < inside; i++) {
      [right, up].forEach((vector, axis) => {
        const reach = along(vector, xs[i], ys[i], zs[i]);
        low[axis] = Math.min(low[axis], reach);
        high[axis] = Math.max(high[axis], reach);
      });
    }
    if (!inside) return;
    const scale = Math.min((wide - 20) / Math.max(high[0] - low[0], 1), (tall - 20) / Math.max(high[1] - low[1], 1));
    const left = wide / 2 - scale * (low[0] + high[0]) / 2, top = tall / 2 + scale * (low[1] + high[1]) / 2;
    canvas.width = wide; canvas.height = tall;
    const raster = new Raster(wide, tall, true);
    const size = Math.max(1.5 * density, Math.min(4 * density, 0.07 * scale));
    for (let patch = 0; patch <= scene.m; patch++) {
      const chosen = patch === look.selected, colour = packedColour(chosen ? (look.mark || MARK).points : patch < scene.m ? look.colour(patch) : look.loose || LOOSE);
      for (let i = scene.start[patch]; i < scene.start[patch + 1]; i++) {
        const place = [xs[i], ys[i], zs[i]];
        raster.dot(left + scale * along(right, ...place), top - scale * along(up, ...place), chosen ? 1.5 * size : patch < scene.m ? size : 0.7 * size, colour, along(toEye, ...place) + (chosen ? 1e4 : 0));
      }
    }
    canvas.getContext("2d").putImageData(raster.image, 0, 0);
  }

  return { PALETTES, Scene, Plan, Space, drawFlat, unpack, gunzip, mix, css, LOOSE };
})();
