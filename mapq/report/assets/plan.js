"use strict";
// The plan view, on a canvas. look: { colour(patch) -> rgb, rank(patch) -> higher is drawn later, selected: number,
// points, outlines: bool, loose -> rgb, mark -> { points, line } }
Views.Plan = (() => {
  const { LOOSE, INK, SOFT, MARK, Raster, css, marginOf, packedColour } = Views;

  function niceStep(least) {
    const power = 10 ** Math.floor(Math.log10(least));
    return [1, 2, 5, 10].map((factor) => +(factor * power).toPrecision(3)).find((step) => step >= least * 0.999);
  }

  return class Plan {
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
      this.scale = Math.min(
        (wide - 50) / Math.max(high[0] - low[0] + 2 * margin, 1),
        (tall - 40) / Math.max(high[1] - low[1] + 2 * margin, 1),
      );
      this.middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
      this.draw();
    }
    size() {
      return this.paper || [this.canvas.clientWidth, this.canvas.clientHeight];
    }
    toPixel(x, y) {
      const d = this.density;
      return [
        this.canvas.width / 2 + (x - this.middle[0]) * this.scale * d,
        this.canvas.height / 2 - (y - this.middle[1]) * this.scale * d,
      ];
    }
    draw() {
      const canvas = this.canvas,
        [wide, tall] = this.size().map((length) => Math.round(length * this.density));
      if (!wide || !tall || !this.scale) return;
      canvas.width = wide;
      canvas.height = tall;
      const raster = new Raster(wide, tall, false),
        size = this.dotSize();
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
    dotSize() {
      return Math.min(6, Math.max(1, 0.05 * this.scale)) * this.density;
    }
    drawPoints(raster, patch, rgb, size) {
      const [x, y] = this.scene.points,
        colour = packedColour(rgb),
        factor = this.scale * this.density;
      const left = this.canvas.width / 2 - this.middle[0] * factor,
        top = this.canvas.height / 2 + this.middle[1] * factor;
      for (let i = this.scene.start[patch]; i < this.scene.start[patch + 1]; i++) {
        raster.dot(left + x[i] * factor, top - y[i] * factor, size, colour, 0);
      }
    }
    path(pen, patch) {
      const [x, y] = this.scene.corners;
      pen.beginPath();
      for (let i = this.scene.cornerStart[patch]; i < this.scene.cornerStart[patch + 1]; i++)
        pen.lineTo(...this.toPixel(x[i], y[i]));
      pen.closePath();
    }
    drawOutlines(pen) {
      pen.lineWidth = this.density;
      pen.lineJoin = "round";
      for (const patch of this.groups) {
        if (this.scene.cornerStart[patch + 1] === this.scene.cornerStart[patch]) continue;
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
      const patch = this.look.selected,
        [x, y] = this.scene.points;
      const mark = this.look.mark || MARK;
      pen.fillStyle = css(mark.points);
      for (let i = this.scene.start[patch]; i < this.scene.start[patch + 1]; i++) {
        const [px, py] = this.toPixel(x[i], y[i]);
        pen.fillRect(px - size * 0.6, py - size * 0.6, size * 1.2, size * 1.2);
      }
      this.path(pen, patch);
      for (const [width, style] of [
        [7, "#fff"],
        [4.5, css(mark.line)],
        [1.5, css(mark.points)],
      ]) {
        pen.lineWidth = width * this.density;
        pen.strokeStyle = style;
        pen.stroke();
      }
    }
    drawFrame(pen) {
      const d = this.density,
        step = niceStep(90 / this.scale),
        wide = this.canvas.width,
        tall = this.canvas.height;
      pen.font = `${11 * d}px system-ui, sans-serif`;
      pen.textBaseline = "alphabetic";
      const label = (text, x, y) => {
        pen.lineWidth = 3 * d;
        pen.strokeStyle = "#fff";
        pen.strokeText(text, x, y);
        pen.fillStyle = SOFT;
        pen.fillText(text, x, y);
      };
      const from = (axis, pixels) => this.middle[axis] - pixels / 2 / this.scale / d;
      for (let x = Math.ceil(from(0, wide) / step) * step; x < from(0, -wide); x += step) {
        const px = this.toPixel(x, 0)[0];
        pen.fillStyle = SOFT;
        pen.fillRect(px, tall - 5 * d, d, 5 * d);
        label(+x.toPrecision(8) + "", px + 3 * d, tall - 4 * d);
      }
      for (let y = Math.ceil(from(1, tall) / step) * step; y < from(1, -tall); y += step) {
        const py = this.toPixel(0, y)[1];
        pen.fillStyle = SOFT;
        pen.fillRect(0, py, 5 * d, d);
        label(+y.toPrecision(8) + "", 7 * d, py + 4 * d);
      }
      const bar = niceStep(60 / this.scale),
        long = bar * this.scale * d,
        right = wide - 14 * d,
        y = 16 * d;
      pen.fillStyle = INK;
      pen.fillRect(right - long, y, long, 3 * d);
      label(`${bar} m`, right - long, y - 4 * d);
    }
    pick(event) {
      const bounds = this.canvas.getBoundingClientRect(),
        d = this.density,
        [x, y] = this.scene.points;
      const px = (event.clientX - bounds.left) * d,
        py = (event.clientY - bounds.top) * d,
        reach = (9 * d) ** 2;
      let best = -1,
        least = Infinity;
      for (let i = 0; i < this.scene.start[this.scene.m]; i++) {
        const [qx, qy] = this.toPixel(x[i], y[i]),
          far = (qx - px) ** 2 + (qy - py) ** 2;
        if (far > reach) continue;
        const patch = this.scene.patchOf(i),
          cost = far - 4 * d * d * this.look.rank(patch);
        if (cost < least) {
          least = cost;
          best = patch;
        }
      }
      return best;
    }
    zoom(factor, px, py) {
      this.fitted = null;
      const x = this.middle[0] + (px - this.canvas.clientWidth / 2) / this.scale,
        y = this.middle[1] - (py - this.canvas.clientHeight / 2) / this.scale;
      this.scale = Math.min(2000, Math.max(1e-3, this.scale * factor));
      this.middle = [
        x - (px - this.canvas.clientWidth / 2) / this.scale,
        y + (py - this.canvas.clientHeight / 2) / this.scale,
      ];
      this.soon();
    }
    move(dx, dy) {
      this.fitted = null;
      this.middle[0] -= dx / this.scale;
      this.middle[1] += dy / this.scale;
      this.soon();
    }
    soon() {
      if (this.waiting) return;
      this.waiting = requestAnimationFrame(() => {
        this.waiting = 0;
        this.draw();
      });
    }
    listen() {
      const canvas = this.canvas;
      let last = null,
        moved = 0;
      canvas.addEventListener(
        "wheel",
        (event) => {
          event.preventDefault();
          this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
        },
        { passive: false },
      );
      canvas.addEventListener("pointerdown", (event) => {
        last = [event.clientX, event.clientY];
        moved = 0;
        canvas.setPointerCapture(event.pointerId);
      });
      canvas.addEventListener("pointermove", (event) => {
        if (!last) return;
        const dx = event.clientX - last[0],
          dy = event.clientY - last[1];
        moved += Math.abs(dx) + Math.abs(dy);
        last = [event.clientX, event.clientY];
        this.move(dx, dy);
      });
      canvas.addEventListener("pointerup", (event) => {
        if (last && moved < 5) {
          const patch = this.pick(event);
          if (patch >= 0) this.onPick(patch);
        }
        last = null;
      });
      canvas.addEventListener("pointercancel", () => {
        last = null;
      });
      canvas.addEventListener("keydown", (event) => {
        const step = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] }[event.key];
        if (step) this.move(...step);
        else if (event.key === "+" || event.key === "=")
          this.zoom(1.3, canvas.clientWidth / 2, canvas.clientHeight / 2);
        else if (event.key === "-") this.zoom(1 / 1.3, canvas.clientWidth / 2, canvas.clientHeight / 2);
        else return;
        event.preventDefault();
        event.stopPropagation();
      });
    }
  };
})();
