"use strict";
// The map in space: drawn by plotly where there is WebGL, else, and for paper, points on a canvas. look: as for the
// plan, and value(patch) -> place on scale() -> [[place, rgb], ...], dot: size of points, opacity of outlines, eye.
(() => {
  const { LOOSE, SOFT, MARK, Raster, css, marginOf, packedColour } = Views;
  const EYE = { x: 0.6, y: -1.05, z: 0.8 };

  function hasWebGL() {
    try {
      const context = document.createElement("canvas").getContext("webgl");
      if (context) context.getExtension("WEBGL_lose_context")?.loseContext();
      return !!context;
    } catch {
      return false;
    }
  }

  // The map in space. Each trace has one colour scale from 0 to 1, cut at the middle where the label changes.
  class Space {
    constructor(element, scene, look, onPick) {
      Object.assign(this, { element, scene, look, onPick, works: hasWebGL() });
      if (!this.works) return;
      const config = {
        displaylogo: false,
        responsive: true,
        modeBarButtonsToRemove: ["toImage", "tableRotation", "resetCameraLastSave3d"],
        scrollZoom: true,
      };
      Plotly.newPlot(element, this.traces(), this.layout(), config);
      // A click of plotly's own needs the button to be held for a frame: what lies under the pointer is known before.
      let under = -1,
        from = null;
      element.on("plotly_hover", (event) => {
        under = this.patchOf(event.points[0]);
      });
      element.on("plotly_unhover", () => {
        under = -1;
      });
      element.addEventListener(
        "pointerdown",
        (event) => {
          from = [event.clientX, event.clientY];
        },
        true,
      );
      element.addEventListener(
        "pointerup",
        (event) => {
          const still = from && Math.hypot(event.clientX - from[0], event.clientY - from[1]) < 4;
          from = null;
          if (still && under >= 0 && under < this.scene.m && !event.target.closest?.(".modebar")) this.onPick(under);
        },
        true,
      );
    }
    patchOf(point) {
      return point.curveNumber === 1
        ? this.scene.patchOf(point.pointNumber)
        : point.curveNumber === 2
          ? this.scene.ownerOf(point.pointNumber)
          : -1;
    }
    layout() {
      const axis = (title) => ({
        title: { text: title },
        backgroundcolor: "#fff",
        gridcolor: "#e4e8ea",
        zeroline: false,
        showspikes: false,
        color: SOFT,
        exponentformat: "none",
      });
      const { x, y, z, aspectratio } = this.frame();
      return {
        margin: { l: 0, r: 0, t: 0, b: 0 },
        showlegend: false,
        hovermode: "closest",
        paper_bgcolor: "#fff",
        uirevision: "stay",
        scene: {
          aspectmode: "manual",
          aspectratio,
          xaxis: { ...axis("x"), range: x },
          yaxis: { ...axis("y"), range: y },
          zaxis: { ...axis("z"), range: z, nticks: 4 },
          camera: { eye: this.look.eye || EYE },
          dragmode: "orbit",
        },
      };
    }
    // What a box needs of the three axes: ranges, and lengths that keep metres alike, the longest 1.
    frame(box) {
      const [low, high] = box || [this.scene.low, this.scene.high],
        margin = box ? marginOf(low, high) : 1;
      const ranges = low.map((value, axis) => [value - margin, high[axis] + margin]),
        lengths = ranges.map(([a, b]) => b - a);
      const most = Math.max(...lengths);
      return {
        x: ranges[0],
        y: ranges[1],
        z: ranges[2],
        aspectratio: { x: lengths[0] / most, y: lengths[1] / most, z: lengths[2] / most },
      };
    }
    scale() {
      const steps = this.look.scale();
      return steps.map(([at, rgb]) => [at, css(rgb)]);
    }
    cut(columns, from, to) {
      return { x: columns[0].subarray(from, to), y: columns[1].subarray(from, to), z: columns[2].subarray(from, to) };
    }
    traces() {
      const { scene, look } = this,
        inside = scene.start[scene.m],
        all = scene.start[scene.m + 1];
      const value = new Float32Array(inside),
        size = look.dot || 2;
      for (let patch = 0; patch < scene.m; patch++)
        value.fill(look.value(patch), scene.start[patch], scene.start[patch + 1]);
      const colours = { cmin: 0, cmax: 1, colorscale: this.scale(), showscale: false };
      return [
        {
          type: "scatter3d",
          mode: "markers",
          hoverinfo: "skip",
          visible: !!look.points,
          ...this.cut(scene.points, inside, all),
          marker: { size: 1.2, color: css(look.loose || LOOSE), line: { width: 0 } },
        },
        {
          type: "scatter3d",
          mode: "markers",
          visible: !!look.points,
          ...this.cut(scene.points, 0, inside),
          marker: { size, color: value, line: { width: 0 }, ...colours },
          hovertemplate: "%{x:.2f}, %{y:.2f}, %{z:.2f}<extra></extra>",
        },
        { ...this.mesh(colours), visible: !!look.outlines },
        ...this.selection(),
      ];
    }
    mesh(colours) {
      const { scene, look } = this,
        i = [],
        j = [],
        k = [],
        intensity = [];
      for (let patch = 0; patch < scene.m; patch++) {
        const first = scene.cornerStart[patch],
          last = scene.cornerStart[patch + 1];
        for (let corner = first + 1; corner + 1 < last; corner++) {
          i.push(first);
          j.push(corner);
          k.push(corner + 1);
          intensity.push(look.value(patch));
        }
      }
      return {
        type: "mesh3d",
        ...this.cut(scene.corners, 0, scene.corners[0].length),
        i,
        j,
        k,
        intensity,
        intensitymode: "cell",
        opacity: look.opacity ?? 0.55,
        flatshading: true,
        hoverinfo: "none",
        lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 },
        ...colours,
      };
    }
    selection() {
      const { scene, look } = this,
        patch = look.selected,
        mark = look.mark || MARK;
      const points =
        patch < 0 ? this.cut(scene.points, 0, 0) : this.cut(scene.points, scene.start[patch], scene.start[patch + 1]);
      const ring = [[], [], []];
      if (patch >= 0) {
        const first = scene.cornerStart[patch],
          last = scene.cornerStart[patch + 1];
        for (let corner = first; corner <= last && last > first; corner++)
          ring.forEach((axis, n) => axis.push(scene.corners[n][corner < last ? corner : first]));
      }
      return [
        {
          type: "scatter3d",
          mode: "markers",
          hoverinfo: "skip",
          ...points,
          marker: { size: (look.dot || 2) + 1, color: css(mark.points), line: { width: 0 } },
        },
        {
          type: "scatter3d",
          mode: "lines",
          hoverinfo: "skip",
          x: ring[0],
          y: ring[1],
          z: ring[2],
          line: { color: css(mark.line), width: 9 },
        },
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
      const update = {
        "scene.xaxis.range": x,
        "scene.yaxis.range": y,
        "scene.zaxis.range": z,
        "scene.aspectratio": aspectratio,
        "scene.camera.eye": this.look.eye || EYE,
      };
      Plotly.relayout(this.element, update);
    }
    eye() {
      return (this.works && this.element._fullLayout?.scene?.camera?.eye) || this.look.eye || EYE;
    }
  }

  // The map in space without WebGL, and for paper: points projected along the eye's line of sight.
  function drawFlat(canvas, scene, look, eye, density, paper) {
    const [wide, tall] = (paper || [canvas.clientWidth, canvas.clientHeight]).map((length) =>
      Math.round(length * density),
    );
    if (!wide || !tall) return;
    const flat = Math.hypot(eye.x, eye.y) || 1e-9,
      length = Math.hypot(flat, eye.z);
    const right = [-eye.y / flat, eye.x / flat, 0],
      toEye = [eye.x / length, eye.y / length, eye.z / length];
    const up = [-toEye[2] * right[1], toEye[2] * right[0], toEye[0] * right[1] - toEye[1] * right[0]];
    const middle = [0, 1, 2].map((axis) => (scene.low[axis] + scene.high[axis]) / 2);
    const along = (vector, x, y, z) =>
      vector[0] * (x - middle[0]) + vector[1] * (y - middle[1]) + vector[2] * (z - middle[2]);
    const [xs, ys, zs] = scene.points,
      inside = scene.start[scene.m] || xs.length;
    const low = [Infinity, Infinity],
      high = [-Infinity, -Infinity];
    for (let i = 0; i < inside; i++) {
      [right, up].forEach((vector, axis) => {
        const reach = along(vector, xs[i], ys[i], zs[i]);
        low[axis] = Math.min(low[axis], reach);
        high[axis] = Math.max(high[axis], reach);
      });
    }
    if (!inside) return;
    const scale = Math.min((wide - 20) / Math.max(high[0] - low[0], 1), (tall - 20) / Math.max(high[1] - low[1], 1));
    const left = wide / 2 - (scale * (low[0] + high[0])) / 2,
      top = tall / 2 + (scale * (low[1] + high[1])) / 2;
    canvas.width = wide;
    canvas.height = tall;
    const raster = new Raster(wide, tall, true);
    const size = Math.max(1.5 * density, Math.min(4 * density, 0.07 * scale));
    for (let patch = 0; patch <= scene.m; patch++) {
      const chosen = patch === look.selected,
        colour = packedColour(
          chosen ? (look.mark || MARK).points : patch < scene.m ? look.colour(patch) : look.loose || LOOSE,
        );
      for (let i = scene.start[patch]; i < scene.start[patch + 1]; i++) {
        const place = [xs[i], ys[i], zs[i]];
        raster.dot(
          left + scale * along(right, ...place),
          top - scale * along(up, ...place),
          chosen ? 1.5 * size : patch < scene.m ? size : 0.7 * size,
          colour,
          along(toEye, ...place) + (chosen ? 1e4 : 0),
        );
      }
    }
    canvas.getContext("2d").putImageData(raster.image, 0, 0);
  }

  Object.assign(Views, { Space, drawFlat });
})();
