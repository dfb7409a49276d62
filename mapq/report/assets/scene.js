"use strict";
// Shared by the report and the labelling page: colours, points and outlines of patches.
const Views = (() => {
  // Pale and deep colour of each label, on paper and in the dark.
  const PALETTES = {
    "blue-red": { plausible: [[176, 203, 235], [22, 82, 164]], suspicious: [[247, 178, 164], [205, 20, 24]] },
    "colour-blind": { plausible: [[158, 196, 226], [0, 74, 136]], suspicious: [[253, 217, 142], [214, 120, 0]] },
    "blue-red dark": { plausible: [[52, 76, 108], [104, 168, 246]], suspicious: [[124, 62, 58], [255, 92, 80]] },
    "colour-blind dark": { plausible: [[44, 78, 104], [90, 178, 240]], suspicious: [[112, 84, 34], [255, 176, 46]] },
  };
  const palette = () => PALETTES[document.body.dataset.palette + (Theme.isDark() ? " dark" : "")];
  const mix = (a, b, t) => a.map((value, i) => Math.round(value + (b[i] - value) * t));
  const css = (rgb) => `rgb(${rgb[0]},${rgb[1]},${rgb[2]})`;

  // Points and outlines, patch after patch; the numbers are those of mapq/report/scene.py.
  class Scene {
    constructor(head, buffer) {
      let place = 0;
      const take = (n) => {
        place += n;
        return new Int32Array(buffer, 4 * (place - n), n);
      };
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
    boxOf(patches) {
      const low = [Infinity, Infinity, Infinity],
        high = [-Infinity, -Infinity, -Infinity];
      for (const patch of patches) {
        for (const [columns, start] of [
          [this.points, this.start],
          [this.corners, this.cornerStart],
        ]) {
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
      this.wide = wide;
      this.high = high;
      this.image = new ImageData(wide, high);
      this.pixels = new Uint32Array(this.image.data.buffer);
      this.depth = withDepth ? new Float32Array(wide * high).fill(-Infinity) : null;
      this.pixels.fill(packedColour(Theme.rgb("map-free")));
    }
    dot(x, y, size, colour, depth) {
      const left = Math.max(0, Math.round(x - size / 2)),
        right = Math.min(this.wide, Math.round(x + size / 2) || 1);
      const top = Math.max(0, Math.round(y - size / 2)),
        bottom = Math.min(this.high, Math.round(y + size / 2) || 1);
      for (let row = top; row < bottom; row++) {
        for (let i = row * this.wide + left; i < row * this.wide + right; i++) {
          if (this.depth) {
            if (this.depth[i] >= depth) continue;
            this.depth[i] = depth;
          }
          this.pixels[i] = colour;
        }
      }
    }
  }
  const packedColour = (rgb) => (255 << 24) | (rgb[2] << 16) | (rgb[1] << 8) | rgb[0];

  // Metres shown around a box.
  const marginOf = (low, high) => Math.max(2, 0.3 * Math.max(...high.map((value, axis) => value - low[axis])));

  // Rows of what was measured of a patch, whose measures `of` gives by name.
  function measured(of) {
    const { figure } = Page;
    return [
      ["points", figure(of("n_points"), 0)],
      ["area", figure(of("area_m2"), 2, " m²")],
      ["width × height", `${figure(of("width_m"), 2)} × ${figure(of("height_m"), 2)} m`],
      ["off its plane (rms)", figure(of("rms_m"), 3, " m")],
      ["thickness", figure(of("thickness_m"), 3, " m")],
      ["tilt from vertical", figure(of("tilt_deg"), 1, "°")],
    ];
  }

  return { Scene, Raster, css, marginOf, measured, mix, packedColour, palette };
})();
