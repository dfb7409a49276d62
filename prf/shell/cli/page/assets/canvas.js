"use strict";
// What all views on a canvas share: axes in metres, a scale bar, and moving by mouse, wheel, touch and keys.
const Canvas = (() => {
  const ZOOM_KEYS = { "+": 1.3, "=": 1.3, "-": 1 / 1.3 };
  const ARROWS = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };

  function niceStep(least) {
    const power = 10 ** Math.floor(Math.log10(least));
    return [1, 2, 5, 10].map((factor) => +(factor * power).toPrecision(3)).find((step) => step >= least * 0.999);
  }
  const metres = (value) =>
    (+value.toPrecision(8)).toLocaleString("en", { maximumFractionDigits: 6 }).replace("-", "−");

  // Words on a canvas, with the colour of the paper round them.
  function label(pen, text, x, y, density, size = 11, ink = "map-soft") {
    pen.font = `${size * density}px system-ui, sans-serif`;
    pen.textBaseline = "alphabetic";
    pen.lineJoin = "round";
    pen.lineWidth = 3 * density;
    pen.strokeStyle = Theme.colour("map-free");
    pen.strokeText(text, x, y);
    pen.fillStyle = Theme.colour(ink);
    pen.fillText(text, x, y);
  }
  // Ticks at the lower and the left side, those whose words fit; scale: pixels of the screen a metre.
  function axes(pen, middle, scale, density) {
    const { width, height } = pen.canvas,
      step = niceStep(90 / scale),
      factor = scale * density;
    for (let k = Math.ceil((middle[0] - width / 2 / factor) / step); ; k++) {
      const px = width / 2 + (k * step - middle[0]) * factor;
      if (px + (7 * metres(k * step).length + 3) * density > width) break;
      if (px < 30 * density) continue;
      label(pen, metres(k * step), px + 3 * density, height - 4 * density, density);
      pen.fillRect(px, height - 5 * density, density, 5 * density);
    }
    for (let k = Math.ceil((middle[1] - height / 2 / factor) / step); ; k++) {
      const py = height / 2 - (k * step - middle[1]) * factor;
      if (py < 14 * density) break;
      label(pen, metres(k * step), 3 * density, py - 3 * density, density);
      pen.fillRect(0, py, 12 * density, density);
    }
  }
  function scaleBar(pen, scale, density) {
    const length = niceStep(60 / scale),
      long = length * scale * density,
      left = pen.canvas.width - 14 * density - long;
    label(pen, `${metres(length)} m`, left, 14 * density, density);
    pen.fillStyle = Theme.colour("map-free");
    pen.fillRect(left - density, 17 * density, long + 2 * density, 5 * density);
    pen.fillStyle = Theme.colour("map-ink");
    pen.fillRect(left, 18 * density, long, 3 * density);
  }

  // The length of each leg of a line through places in pixels; lengths in metres.
  function measure(pen, places, lengths, density) {
    pen.save();
    pen.lineJoin = pen.lineCap = "round";
    for (const [width, colour] of [[4.5, "map-free"], [2, "question"]]) {
      pen.lineWidth = width * density;
      pen.strokeStyle = pen.fillStyle = Theme.colour(colour);
      pen.beginPath();
      for (const [x, y] of places) pen.lineTo(x, y);
      pen.stroke();
      for (const [x, y] of places) {
        pen.beginPath();
        pen.arc(x, y, (1.5 + width / 2) * density, 0, 7);
        pen.fill();
      }
    }
    pen.textAlign = "center";
    lengths.forEach((length, i) => {
      const [x, y] = [0, 1].map((axis) => (places[i][axis] + places[i + 1][axis]) / 2);
      label(pen, `${Page.figure(length, 2)} m`, x, y - 6 * density, density, 13, "map-ink");
    });
    pen.restore();
  }
  // The middle of a canvas, where Enter acts.
  function cross(pen, density) {
    const [x, y, arm, width] = [pen.canvas.width / 2, pen.canvas.height / 2, 9 * density, 2 * density];
    pen.fillStyle = Theme.colour("question");
    pen.fillRect(x - arm, y - width / 2, 2 * arm, width);
    pen.fillRect(x - width / 2, y - arm, width, 2 * arm);
  }
  const legsOf = (points) =>
    points.slice(1).map((point, i) => Math.hypot(...point.map((value, axis) => value - points[i][axis])));

  // on: { zoom(factor, x, y), drag(dx, dy, turnsOrMoves: bool), click(event) }; pixels of the screen. Two fingers move
  // and zoom at once.
  function gestures(canvas, on) {
    const held = new Map();
    let moved = 0;
    const centre = () => {
      const points = [...held.values()],
        [x, y] = [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / points.length);
      return [x, y, Math.hypot(points[0][0] - x, points[0][1] - y)];
    };
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        on.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
      },
      { passive: false },
    );
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      if (!held.size) moved = 0;
      held.set(event.pointerId, [event.clientX, event.clientY]);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!held.has(event.pointerId)) return;
      const [x, y, apart] = centre();
      held.set(event.pointerId, [event.clientX, event.clientY]);
      const [newX, newY, newApart] = centre();
      moved += Math.abs(newX - x) + Math.abs(newY - y) + (held.size > 1 ? 5 : 0);
      on.drag(newX - x, newY - y, event.shiftKey || event.buttons === 2 || held.size > 1);
      if (held.size < 2 || !apart) return;
      const bounds = canvas.getBoundingClientRect();
      on.zoom(newApart / apart, newX - bounds.left, newY - bounds.top);
    });
    canvas.addEventListener("pointerup", (event) => {
      if (held.delete(event.pointerId) && !held.size && moved < 5) on.click(event);
    });
    canvas.addEventListener("pointercancel", (event) => held.delete(event.pointerId));
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (ARROWS[event.key]) on.drag(...ARROWS[event.key], event.shiftKey);
      else if (ZOOM_KEYS[event.key]) on.zoom(ZOOM_KEYS[event.key]);
      else return;
      event.preventDefault();
      event.stopPropagation();
    });
  }
  return { axes, cross, gestures, legsOf, measure, niceStep, scaleBar };
})();
