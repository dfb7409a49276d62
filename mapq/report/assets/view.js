"use strict";
// A view of the map on a canvas, without perspective: the plan view from above, or, with an eye, a 3D view that turns.
// look: { colour(patch) -> rgb, rank(patch) -> higher is drawn later in plan, selected: number, points, outlines: bool,
// mark -> { points, line }, measuring: bool, marks -> { view, places: [[x, y, z]...] } }
Views.View = (() => {
  const { Raster, css, marginOf, packedColour } = Views;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  return class View {
    // eye: null for the plan view, else [turn, rise] in radians, from x to y and above the horizon.
    constructor(canvas, scene, look, onPick, eye = null, onMark = null) {
      Object.assign(this, { canvas, look, onPick, eye, onMark, density: window.devicePixelRatio || 1, paper: null });
      this.set(scene);
      // What was fitted stays so: a page that is laid out, or folded, gives the view another size.
      new ResizeObserver(() => (this.fitted && !this.paper ? this.show(this.fitted.box) : this.draw())).observe(canvas);
      Canvas.gestures(canvas, {
        zoom: (factor, x, y) => this.zoom(factor, x, y),
        drag: (dx, dy, moves) => (eye && !moves ? this.turn(dx, dy) : this.move(dx, dy)),
        click: (event) => this.click(event.offsetX * this.density, event.offsetY * this.density),
      });
      canvas.addEventListener("keydown", (event) => {
        if (event.key === "Enter" && look.measuring) this.click(canvas.width / 2, canvas.height / 2);
      });
      for (const name of ["focus", "blur"]) canvas.addEventListener(name, () => look.measuring && this.draw());
    }
    set(scene) {
      this.scene = scene;
      this.groups = [...Array(scene.m).keys()].sort((a, b) => this.look.rank(a) - this.look.rank(b));
      this.show();
    }
    // Unit vectors to the right, up and to the eye.
    axes() {
      const [turn, rise] = this.eye || [-Math.PI / 2, Math.PI / 2];
      const [ct, st, cr, sr] = [Math.cos(turn), Math.sin(turn), Math.cos(rise), Math.sin(rise)];
      return [[-st, ct, 0], [-sr * ct, -sr * st, cr], [cr * ct, cr * st, sr]];
    }
    show(box) {
      this.fitted = { box };
      const [low, high] = box || [this.scene.low, this.scene.high];
      const margin = box ? marginOf(low, high) : 0,
        [right, up] = this.axes(),
        [wide, tall] = this.size();
      const sides = high.map((value, axis) => value - low[axis] + 2 * margin),
        along = (axis) => dot(axis.map(Math.abs), sides);
      this.middle = low.map((value, axis) => (value + high[axis]) / 2);
      this.scale = Math.min((wide - 50) / Math.max(along(right), 1), (tall - 40) / Math.max(along(up), 1));
      this.draw();
    }
    size() {
      return this.paper || [this.canvas.clientWidth, this.canvas.clientHeight];
    }
    // Rows of the affine map from a place to pixels of the canvas and to its nearness in metres.
    projection() {
      const factor = this.scale * this.density,
        [right, up, eye] = this.axes(),
        row = (axis, scale, from) => [...axis.map((value) => scale * value), from - scale * dot(axis, this.middle)];
      return [row(right, factor, this.canvas.width / 2), row(up, -factor, this.canvas.height / 2), row(eye, 1, 0)];
    }
    place(x, y, z) {
      return this.rows.map((row) => row[0] * x + row[1] * y + row[2] * z + row[3]);
    }
    draw() {
      const canvas = this.canvas,
        [wide, tall] = this.size().map((length) => Math.round(length * this.density));
      if (!wide || !tall || !this.scale) return;
      canvas.width = wide;
      canvas.height = tall;
      const raster = new Raster(wide, tall, !!this.eye),
        size = Math.min(6, Math.max(1, 0.05 * this.scale)) * this.density;
      this.rows = this.projection();
      if (this.look.points) {
        this.drawPoints(raster, this.scene.m, Theme.rgb("map-loose"), Math.max(1, 0.8 * size));
        for (const patch of this.groups) this.drawPoints(raster, patch, this.look.colour(patch), size);
      }
      const pen = canvas.getContext("2d"),
        sheet = Object.assign(document.createElement("canvas"), { width: wide, height: tall });
      sheet.getContext("2d").putImageData(raster.image, 0, 0);
      pen.drawImage(sheet, 0, 0); // browsers that print a canvas by its strokes leave pixels out that were put into it
      if (this.look.outlines) this.drawOutlines(pen);
      if (this.look.selected >= 0) this.drawSelected(pen, size);
      const { measuring, marks } = this.look;
      if (marks?.view === this) {
        const pixels = marks.places.map((place) => this.place(...place).slice(0, 2));
        Canvas.measure(pen, pixels, Canvas.legsOf(marks.places), this.density);
      }
      if (measuring && canvas.matches(":focus-visible")) Canvas.cross(pen, this.density);
      if (!this.eye) Canvas.axes(pen, this.middle, this.scale, this.density);
      Canvas.scaleBar(pen, this.scale, this.density);
    }
    eachPoint(patch, visit) {
      const [x, y, z] = this.scene.points;
      const [[a, b, c, d], [e, f, g, h], [k, l, m, n]] = this.rows;
      for (let i = this.scene.start[patch]; i < this.scene.start[patch + 1]; i++) {
        const [u, v, w] = [x[i], y[i], z[i]];
        visit(a * u + b * v + c * w + d, e * u + f * v + g * w + h, k * u + l * v + m * w + n, i);
      }
    }
    drawPoints(raster, patch, rgb, size) {
      const colour = packedColour(rgb);
      this.eachPoint(patch, (px, py, near) => raster.dot(px, py, size, colour, near));
    }
    path(pen, patch) {
      const [x, y, z] = this.scene.corners;
      pen.beginPath();
      for (let i = this.scene.cornerStart[patch]; i < this.scene.cornerStart[patch + 1]; i++)
        pen.lineTo(...this.place(x[i], y[i], z[i]).slice(0, 2));
      pen.closePath();
    }
    // In plan by rank, in 3D those far off first.
    outlined() {
      const start = this.scene.cornerStart,
        groups = this.groups.filter((patch) => start[patch + 1] > start[patch]);
      if (!this.eye) return groups;
      const near = groups.map((patch) => this.place(...this.scene.corners.map((axis) => axis[start[patch]]))[2]);
      return [...groups.keys()].sort((a, b) => near[a] - near[b]).map((index) => groups[index]);
    }
    drawOutlines(pen) {
      pen.lineWidth = this.density;
      pen.lineJoin = "round";
      for (const patch of this.outlined()) {
        this.path(pen, patch);
        pen.fillStyle = pen.strokeStyle = css(this.look.colour(patch));
        pen.globalAlpha = 0.16;
        pen.fill();
        pen.globalAlpha = 0.9;
        pen.stroke();
      }
      pen.globalAlpha = 1;
    }
    drawSelected(pen, size) {
      const mark = this.look.mark || { points: this.look.colour(this.look.selected), line: [240, 160, 0] },
        half = 0.6 * size;
      pen.fillStyle = css(mark.points);
      this.eachPoint(this.look.selected, (px, py) => pen.fillRect(px - half, py - half, 2 * half, 2 * half));
      this.path(pen, this.look.selected);
      for (const [width, style] of [[7, Theme.colour("map-free")], [4.5, css(mark.line)], [1.5, css(mark.points)]]) {
        pen.lineWidth = width * this.density;
        pen.strokeStyle = style;
        pen.stroke();
      }
    }
    // By pixels of the canvas: selects the patch there, or marks the place to measure from: in plan that of the click,
    // in 3D that of the point there.
    click(px, py) {
      const { scene, look, density, scale, middle } = this,
        [patch, i] = this.pick(px, py);
      if (!look.measuring) return patch >= 0 && this.onPick(patch);
      const along = (px - this.canvas.width / 2) / density / scale,
        up = (this.canvas.height / 2 - py) / density / scale;
      if (!this.eye) this.onMark(this, [middle[0] + along, middle[1] + up, 0]);
      else if (i >= 0) this.onMark(this, scene.points.map((axis) => axis[i]));
    }
    // The patch at a place and its point: suspicious ones before others in plan, near ones before far ones in 3D; -1: none.
    pick(px, py) {
      const d = this.density,
        reach = (9 * d) ** 2;
      let best = [-1, -1],
        least = Infinity;
      for (let patch = 0; patch < this.scene.m; patch++) {
        const favour = this.eye ? 0 : 4 * d * d * this.look.rank(patch);
        this.eachPoint(patch, (qx, qy, near, i) => {
          const far = (qx - px) ** 2 + (qy - py) ** 2,
            cost = far - favour - (this.eye ? near * reach : 0);
          if (far > reach || cost >= least) return;
          least = cost;
          best = [patch, i];
        });
      }
      return best;
    }
    zoom(factor, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
      const dx = px - this.canvas.clientWidth / 2,
        dy = py - this.canvas.clientHeight / 2,
        before = this.scale;
      this.scale = Math.min(2000, Math.max(1e-3, before * factor));
      const shift = this.scale / before - 1;
      this.move(-dx * shift, -dy * shift);
    }
    // By pixels of the screen.
    move(dx, dy) {
      this.fitted = null;
      const [right, up] = this.axes();
      this.middle = this.middle.map((value, axis) => value - (dx * right[axis] - dy * up[axis]) / this.scale);
      this.soon();
    }
    turn(dx, dy) {
      const limit = Math.PI / 2;
      this.eye = [this.eye[0] - 0.008 * dx, Math.min(limit, Math.max(-limit, this.eye[1] + 0.008 * dy))];
      this.soon();
    }
    soon() {
      this.waiting ||= requestAnimationFrame(() => {
        this.waiting = 0;
        this.draw();
      });
    }
    // Draws for paper, at the density of a printer; returns what brings the screen back.
    print(paper) {
      const { scale, middle, density, canvas } = this,
        factor = Math.min(paper[0] / canvas.clientWidth, paper[1] / canvas.clientHeight);
      Object.assign(this, { paper, density: 3 });
      if (this.fitted) this.show(this.fitted.box);
      else {
        this.scale *= Number.isFinite(factor) && factor > 0 ? factor : 1;
        this.draw();
      }
      return () => {
        Object.assign(this, { scale, middle, density, paper: null });
        this.draw();
      };
    }
  };
})();
