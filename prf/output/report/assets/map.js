"use strict";
// The map on a canvas. look: { base: "posterior" | "returns" | "draw" | "best", draw, outline, path, ellipses, given,
// readings, differs, places: bool, tool: "point" | "path" | "length", corners: [[x, y]...], radius }
Prf.Map = class {
  constructor(canvas, content, look, onPick) {
    Object.assign(this, { canvas, look, onPick, density: window.devicePixelRatio || 1 });
    this.set(...content);
    this.show();
    new ResizeObserver(() => (this.fitted ? this.show(this.fitted) : this.draw())).observe(canvas);
    Canvas.gestures(canvas, {
      zoom: (factor, x, y) => this.zoom(factor, x, y),
      drag: (dx, dy) => this.move(dx, dy),
      click: (event) => onPick(this.where(event.offsetX, event.offsetY)),
    });
    for (const name of ["focus", "blur"]) canvas.addEventListener(name, () => this.draw());
    addEventListener("themechange", () => {
      this.paint();
      this.draw();
    });
  }
  set(data, draws, cells, scene) {
    Object.assign(this, { window: data.window, step: data.step, places: data.places, cells: data.cells, draws, scene });
    const n = this.cells.nx * this.cells.ny;
    this.occupancy = cells.subarray(0, n);
    this.difference = cells.subarray(n, 2 * n);
    this.seen = cells.subarray(2 * n, 3 * n);
    this.returns = cells.subarray(3 * n);
    this.best = data.map ? this.polygons(JSON.parse(data.map).geometry.coordinates) : null;
    this.drawn = null;
    this.paint();
  }
  polygons(coordinates) {
    const path = new Path2D();
    for (const ring of coordinates.flat()) {
      ring.forEach(([x, y], i) => path[i ? "lineTo" : "moveTo"](...this.draws.local([x, y])));
      path.closePath();
    }
    return path;
  }
  // One pixel a cell, the highest row first.
  picture(colour) {
    const { nx, ny } = this.cells,
      image = new ImageData(nx, ny),
      made = Object.assign(document.createElement("canvas"), { width: nx, height: ny });
    for (let row = 0; row < ny; row++)
      for (let column = 0; column < nx; column++)
        image.data.set(colour(row * nx + column), 4 * ((ny - 1 - row) * nx + column));
    made.getContext("2d").putImageData(image, 0, 0);
    return made;
  }
  // Pictures of the cells in the colours of the theme.
  paint() {
    const [free, black, violet, veil] = ["free", "occupied", "map-differs", "map-guess"].map(Theme.rgb);
    const grey = (share) => [...free.map((value, c) => value + ((black[c] - value) * share) / 255), 255];
    this.posterior = this.picture((i) => grey(this.occupancy[i]));
    this.returning = this.cells.square && this.picture((i) => grey(this.returns[i]));
    this.unseen = this.picture((i) => [0, 0, 0, this.seen[i] ? 0 : 255]);
    this.nearSeen = this.picture((i) => [0, 0, 0, this.isNearSeen(i) ? 255 : 0]);
    this.veil = this.picture((i) => [...veil, this.seen[i] ? 0 : 170]);
    this.differing = this.picture((i) => [...violet, this.differs(i) ? 0.6 * this.difference[i] : 0]);
  }
  // Whether a cell or one of those round it was seen.
  isNearSeen(cell) {
    const { nx, ny } = this.cells,
      [column, row] = [cell % nx, Math.floor(cell / nx)];
    for (let y = Math.max(0, row - 1); y <= Math.min(ny - 1, row + 1); y++)
      for (let x = Math.max(0, column - 1); x <= Math.min(nx - 1, column + 1); x++)
        if (this.seen[y * nx + x]) return true;
    return false;
  }
  differs(cell) {
    return this.seen[cell] && this.difference[cell] > this.cells.differs;
  }
  size() {
    return [this.canvas.clientWidth, this.canvas.clientHeight];
  }
  // box: [x0, y0, x1, y1] in metres; the whole window without.
  show(box = this.window) {
    const [wide, high] = this.size(),
      [x0, y0, x1, y1] = box;
    this.fitted = box;
    this.middle = [(x0 + x1) / 2, (y0 + y1) / 2];
    this.scale = Math.max(1e-6, Math.min((wide - 70) / (x1 - x0), (high - 56) / (y1 - y0)));
    this.draw();
  }
  where(px, py) {
    const [wide, high] = this.size();
    return [this.middle[0] + (px - wide / 2) / this.scale, this.middle[1] - (py - high / 2) / this.scale];
  }
  onCanvas([x, y]) {
    const factor = this.scale * this.density;
    return [this.canvas.width / 2 + (x - this.middle[0]) * factor, this.canvas.height / 2 - (y - this.middle[1]) * factor];
  }
  zoom(factor, px = this.size()[0] / 2, py = this.size()[1] / 2) {
    const before = this.where(px, py);
    this.scale = Math.min(4000, Math.max(0.05, this.scale * factor));
    const after = this.where(px, py);
    this.middle = this.middle.map((value, axis) => value + before[axis] - after[axis]);
    this.soon();
  }
  move(dx, dy) {
    this.middle = [this.middle[0] - dx / this.scale, this.middle[1] + dy / this.scale];
    this.soon();
  }
  soon() {
    this.fitted = null;
    this.waiting ||= requestAnimationFrame(() => {
      this.waiting = 0;
      this.draw();
    });
  }
  // From metres, or with a step from steps of the window's corner, to pixels of the canvas.
  toPixels(pen, step) {
    const factor = this.scale * this.density,
      [x0, y0] = step ? this.window : [0, 0],
      { width, height } = this.canvas,
      [mx, my] = this.middle;
    const unit = factor * (step || 1);
    pen.setTransform(unit, 0, 0, -unit, width / 2 + (x0 - mx) * factor, height / 2 + (my - y0) * factor);
    return this.density / unit;
  }
  draw() {
    const { canvas, look } = this,
      pen = canvas.getContext("2d");
    [canvas.width, canvas.height] = this.size().map((length) => Math.round(length * this.density));
    if (!canvas.width || !canvas.height) return;
    const pixel = this.toPixels(pen, this.step),
      [wide, high] = this.draws.size;
    pen.save();
    pen.beginPath();
    pen.rect(0, 0, wide, high);
    pen.fillStyle = Theme.colour("free");
    pen.fill();
    pen.clip();
    pen.fillStyle = Theme.colour("occupied");
    if (look.base === "posterior") this.drawCells(pen, this.posterior);
    else if (look.base === "returns") this.drawCells(pen, this.returning);
    else if (look.base === "best") pen.fill(this.best, "evenodd");
    else pen.fill(this.area(look.draw), "evenodd");
    this.drawUnseen(pen);
    if (look.differs) this.drawCells(pen, this.differing);
    pen.restore();
    this.drawScene(pen, pixel);
    if (look.places) this.drawPlaces(pen);
    this.drawQuestion(pen);
    this.toPixels(pen, this.step);
    pen.lineWidth = pixel;
    pen.strokeStyle = Theme.colour("rim");
    pen.strokeRect(0, 0, wide, high);
    pen.resetTransform();
    if (canvas.matches(":focus-visible")) Canvas.cross(pen, this.density);
    Canvas.axes(pen, this.middle, this.scale, this.density);
    Canvas.scaleBar(pen, this.scale, this.density);
  }
  area(draw) {
    if (this.drawn?.draw !== draw) this.drawn = { draw, path: this.draws.area(draw) };
    return this.drawn.path;
  }
  drawCells(pen, picture) {
    const { nx, ny, origin, resolution } = this.cells,
      [x, y] = this.draws.local([origin[0], origin[1] + ny * resolution]),
      side = resolution / this.step;
    pen.save();
    pen.imageSmoothingEnabled = false;
    pen.transform(1, 0, 0, -1, x, y);
    pen.drawImage(picture, 0, 0, nx * side, ny * side);
    pen.restore();
  }
  // What stroke(pen) draws at once, where a picture of the cells lets it through: on a canvas of its own.
  drawThrough(pen, picture, stroke) {
    const { width, height } = this.canvas,
      sheet = Object.assign(document.createElement("canvas"), { width, height }),
      ink = sheet.getContext("2d");
    this.toPixels(ink, this.step);
    this.drawCells(ink, picture);
    ink.globalCompositeOperation = "source-in";
    stroke(ink);
    pen.save();
    pen.resetTransform();
    pen.drawImage(sheet, 0, 0);
    pen.restore();
  }
  // Where no reading was, the guess of the prior under a veil and hatches as wide as pixels.
  drawUnseen(pen) {
    const { width, height } = this.canvas;
    this.drawCells(pen, this.veil);
    this.drawThrough(pen, this.unseen, (ink) => {
      ink.resetTransform();
      ink.strokeStyle = Theme.colour("map-unseen");
      ink.lineWidth = 0.8 * this.density;
      ink.beginPath();
      for (let x = -height; x < width; x += 9 * this.density) {
        ink.moveTo(x, height);
        ink.lineTo(x + height, 0);
      }
      ink.stroke();
    });
  }
  drawScene(pen, pixel) {
    const { look, scene } = this,
      dots = (numbers, size) => {
        const side = size * pixel;
        for (let i = 0; i < numbers.length; i += 2)
          pen.fillRect(numbers[i] - side / 2, numbers[i + 1] - side / 2, side, side);
      },
      lines = (numbers, each, width, colour, ink = pen) => {
        ink.lineJoin = ink.lineCap = "round";
        ink.beginPath();
        for (let i = 0; i < numbers.length; i += 2) ink[i % each ? "lineTo" : "moveTo"](numbers[i], numbers[i + 1]);
        ink.lineWidth = width * pixel;
        ink.strokeStyle = Theme.colour(colour);
        ink.stroke();
      };
    pen.lineJoin = pen.lineCap = "round";
    if (look.outline && look.base !== "best")
      this.drawThrough(pen, this.nearSeen, (ink) => lines(scene.best, 4, 1.4, "map-outline", ink));
    if (look.readings) {
      pen.fillStyle = Theme.colour("map-return");
      dots(scene.returns, 2);
      dots(scene.points, 4);
      lines(scene.arcs, 6, 0.7, "map-return");
    }
    if (look.given) lines(scene.given, scene.given.length, 1, "map-given");
    if (look.ellipses) {
      pen.beginPath();
      for (let i = 0; i < scene.ellipses.length; i += 6) {
        const [x, y, ax, ay, bx, by] = scene.ellipses.subarray(i, i + 6),
          a = Math.hypot(ax - x, ay - y),
          turn = Math.atan2(ay - y, ax - x);
        pen.moveTo(ax, ay);
        pen.ellipse(x, y, a, Math.hypot(bx - x, by - y), turn, 0, 7);
      }
      pen.lineWidth = pixel;
      pen.strokeStyle = Theme.colour("map-path");
      pen.stroke();
    }
    if (look.path && scene.path.length) {
      lines(scene.path, scene.path.length, 1.2, "map-path");
      pen.fillStyle = Theme.colour("map-path");
      dots(scene.path, 3);
      dots(scene.path.slice(0, 2), 9);
    }
  }
  // An arrow along the heading from each place to look from, as long on the screen at every zoom, and its gain.
  drawPlaces(pen) {
    const unit = this.density;
    pen.save();
    pen.lineJoin = pen.lineCap = "round";
    pen.font = `bold ${13 * unit}px system-ui, sans-serif`;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    const written = [];
    this.places.forEach(({ x, y, theta, gain }, rank) => {
      pen.resetTransform();
      pen.translate(...this.onCanvas([x, y]));
      pen.rotate(-theta);
      pen.strokeStyle = "#ffffff";
      pen.fillStyle = Theme.colour("map-places");
      pen.lineWidth = 2 * unit;
      pen.globalAlpha = rank ? 0.75 : 1;
      pen.beginPath();
      for (const [along, aside] of [[0, 2], [18, 2], [18, 7], [31, 0], [18, -7], [18, -2], [0, -2]])
        pen.lineTo(along * unit, aside * unit);
      pen.closePath();
      pen.stroke();
      pen.fill();
      pen.beginPath();
      pen.arc(0, 0, 5 * unit, 0, 7);
      pen.stroke();
      pen.fill();
      pen.translate(-18 * unit, 0);
      pen.rotate(theta);
      const { e, f } = pen.getTransform(),
        words = gain >= 10 ? gain.toFixed(0) : String(+gain.toPrecision(2));
      // The better place, which comes first, has its gain written where two would lie over one another.
      if (written.some(([u, v]) => Math.abs(u - e) < 26 * unit && Math.abs(v - f) < 15 * unit)) return;
      written.push([e, f]);
      pen.globalAlpha = 1;
      pen.lineWidth = 4 * unit;
      pen.strokeText(words, 0, 0);
      pen.fillText(words, 0, 0);
    });
    pen.restore();
  }
  drawQuestion(pen) {
    const { corners, radius, tool } = this.look;
    if (!corners.length) return;
    if (tool === "length") {
      pen.resetTransform();
      return Canvas.measure(pen, corners.map((corner) => this.onCanvas(corner)), Canvas.legsOf(corners), this.density);
    }
    const pixel = this.toPixels(pen),
      isPath = tool === "path";
    pen.lineJoin = pen.lineCap = "round";
    pen.beginPath();
    corners.forEach(([x, y]) => pen.lineTo(x, y));
    if (corners.length === 1) pen.lineTo(...corners[0]);
    const strokes = isPath ? [[2 * radius, 0.3], [2 * pixel, 1]] : [];
    for (const [width, alpha] of strokes) {
      pen.lineWidth = width;
      pen.globalAlpha = alpha;
      pen.strokeStyle = Theme.colour("question");
      pen.stroke();
    }
    for (const [x, y] of corners) {
      pen.beginPath();
      pen.arc(x, y, (isPath ? 4 : 6) * pixel, 0, 7);
      pen.fillStyle = Theme.colour("question");
      pen.fill();
      pen.lineWidth = 2 * pixel;
      pen.strokeStyle = "#ffffff";
      pen.stroke();
    }
  }
};
