"use strict";
(async () => {
  const { byId, choice, element, figure, press } = Page;
  const [data, drawn, cells, numbers] = await Promise.all([
    Page.unpackJson("data"),
    Page.unpack("draws"),
    Page.unpack("cells"),
    Page.unpack("scene"),
  ]);
  const draws = new Prf.Draws(data.draws, drawn, data.window, data.step),
    whole = Prf.whole(numbers),
    scene = {};
  let place = 0;
  for (const [name, size] of Object.entries(data.scene)) scene[name] = whole.subarray(place, (place += size));
  const look = { base: "posterior", draw: 0, tool: "point", corners: [], radius: 0.25 };
  // A path that was sampled is what to look at.
  byId("path").checked ||= scene.given.length > 0;
  for (const name of ["outline", "path", "ellipses", "given", "readings", "differs", "places"]) look[name] = byId(name).checked;

  // Neighbours on the slider are draws of different chains.
  const order = [...Array(draws.n).keys()].sort(
    (a, b) => a - draws.starts[draws.chainOf(a)] - (b - draws.starts[draws.chainOf(b)]) || a - b,
  );
  const map = new Prf.Map(byId("map"), data, draws, new Uint8Array(cells), scene, look, pick);

  // ---- what is shown
  function show(base, position = +byId("draw").value) {
    look.base = base;
    look.draw = order[position];
    byId("draw").value = position;
    pressBase(base);
    const chain = draws.chainOf(look.draw);
    byId("drawn").textContent =
      `draw ${figure(position + 1, 0)} of ${figure(draws.n, 0)}: chain ${draws.chains[chain] + 1}, ` +
      `step ${figure(draws.steps[look.draw], 0)}`;
    byId("draw").setAttribute("aria-valuetext", byId("drawn").textContent);
    byId("shown").textContent = {
      posterior: "Probability of being occupied",
      returns: "Probability that a beam which comes here ends here",
      draw: `One map of the posterior: ${byId("drawn").textContent}`,
      best: "The most probable map recorded",
    }[base];
    map.draw();
  }
  let timer = 0;
  function play(on) {
    clearInterval(timer);
    timer = on ? setInterval(() => show("draw", (+byId("draw").value + 1) % draws.n), 350) : 0;
    press("play", on);
    byId("play").textContent = on ? "❚❚" : "▶";
  }
  byId("play").addEventListener("click", () => play(!timer));
  byId("draw").max = draws.n - 1;
  byId("draw").addEventListener("input", () => show("draw"));
  const pressBase = choice("base", (base) => {
    play(false);
    show(base);
  });
  const has = {
    outline: scene.best.length,
    path: scene.path.length,
    ellipses: scene.ellipses.length,
    given: scene.given.length,
    readings: scene.returns.length + scene.arcs.length + scene.points.length,
    differs: map.difference.some((_, cell) => map.differs(cell)),
    places: data.places.length,
  };
  for (const name of Object.keys(has)) {
    byId(name).parentElement.hidden = !has[name];
    byId(name).addEventListener("change", () => {
      look[name] = byId(name).checked;
      map.draw();
    });
  }
  byId("whole").addEventListener("click", () => map.show());
  choice("place", (place) => {
    const [x, y, side] = place.split(",").map(Number),
      reach = Math.max(1.5, 2 * side);
    map.show([x - reach, y - reach, x + reach, y + reach]);
    byId("map").scrollIntoView({ block: "nearest" });
  });
  byId("geojson").disabled = document.querySelector("[data-base=best]").disabled = !map.best;
  document.querySelector("[data-base=returns]").hidden = !data.cells.square;
  byId("geojson").addEventListener("click", () =>
    Page.save(`${data.name}.geojson`, new Blob([data.map], { type: "application/geo+json" })),
  );
  byId("png").addEventListener("click", () => byId("map").toBlob((blob) => Page.save(`${data.name}.png`, blob)));

  // ---- questions
  const note = { class: "note" },
    metres = (value) => String(+value.toFixed(3)),
    asPath = () => look.tool === "path";
  function tool(name) {
    look.tool = name;
    if (!asPath()) look.corners = look.corners.slice(-1);
    pressTool(name);
    byId("disc").hidden = byId("drawing").hidden = !asPath();
    byId("hint").textContent = asPath()
      ? "Click the corners of the path, or give them: x, y; x, y"
      : "Click the map, or give x, y in metres";
    ask(true);
  }
  function pick(point) {
    look.corners = asPath() ? [...look.corners, point] : [point];
    ask(true);
  }
  // written: whether the field of coordinates is to follow the map.
  function ask(written) {
    if (written) byId("where").value = look.corners.map((point) => point.map(metres).join(", ")).join("; ");
    look.corners = parsed(byId("where").value).slice(asPath() ? 0 : -1);
    byId("metres").textContent = figure(look.radius, 2, " m");
    byId("undo").disabled = byId("clear").disabled = !look.corners.length;
    map.draw();
    const wrong = byId("where").value.trim() ? [element("p", "These are no coordinates: give x, y in metres.")] : [];
    byId("answer").replaceChildren(...(look.corners.length ? answer() : wrong));
  }
  function parsed(text) {
    const pairs = text.split(/[;\n]/).map((pair) => pair.trim().split(/[\s,]+/).map(Number));
    return pairs.every((pair) => pair.length === 2 && pair.every(Number.isFinite)) ? pairs : [];
  }
  function answer() {
    if (!look.corners.every((point) => draws.inside(point)))
      return [element("p", "Outside the window: nothing is known there.")];
    const event = asPath() ? draws.clearAlong(look.corners, look.radius) : draws.blackAt(look.corners[0]),
      found = Prf.estimate(event, draws.starts, draws.smallestEss),
      share = (value) => `${100 * value}%`,
      what = asPath() ? "all of it is free" : "it is occupied",
      known = Number.isNaN(found.ess) ? "too few draws" : `ESS ${figure(found.ess, 0)}, R-hat ${rhat(found)}`,
      scale = element("div", [element("i", ""), element("b", "")], { class: "scale", "aria-hidden": "true" });
    scale.firstChild.style.cssText = `left:${share(found.low)};right:${share(1 - found.high)}`;
    scale.lastChild.style.left = share(found.p);
    return [
      element("p", [element("strong", figure(found.p, 3)), ` probability that ${what}`]),
      scale,
      element("p", `${figure(found.low, 3)} to ${figure(found.high, 3)}`, { id: "bounds" }),
      element("p", [known, doubt(found)], note),
      ...(asPath() ? against(event) : beside()),
    ];
  }
  const rhat = (found) => (found.rhat === Infinity ? "∞" : figure(found.rhat, 2));
  const doubt = (found) =>
    found.ess >= 100 && found.rhat <= 1.1 ? "" : element("span", ": not known well, sample longer", { class: "wary" });
  // What else is known of a point: that no reading was there, or what a beam meets in its cell.
  function beside() {
    const { nx, ny, origin, resolution, square } = data.cells,
      [column, row] = look.corners[0].map((value, axis) => Math.floor((value - origin[axis]) / resolution)),
      cell = row * nx + column;
    if (!(column >= 0 && row >= 0 && column < nx && row < ny && map.seen[cell]))
      return [element("p", "No reading saw this place: p is the prior's.", note)];
    const words = `${figure(map.returns[cell] / 255, 2)} probability that a beam ends here (p_return of ${square} m)`;
    return square ? [element("p", words, { ...note, id: "returned" })] : [];
  }
  // A draw in which the path is blocked, to look at.
  function against(event) {
    const blocked = order.filter((draw) => !event[draw]);
    if (!blocked.length) return [];
    const button = element("button", "show one", { type: "button", class: "link" });
    let next = 0;
    button.addEventListener("click", () => show("draw", order.indexOf(blocked[next++ % blocked.length])));
    return [element("p", [`Blocked in ${figure(blocked.length, 0)} of ${figure(draws.n, 0)} draws: `, button], note)];
  }
  const pressTool = choice("tool", tool);
  byId("radius").addEventListener("input", () => {
    look.radius = +byId("radius").value;
    ask(false);
  });
  byId("where").addEventListener("change", () => ask(false));
  byId("undo").addEventListener("click", () => {
    look.corners = look.corners.slice(0, -1);
    ask(true);
  });
  byId("clear").addEventListener("click", () => {
    look.corners = [];
    ask(true);
  });
  byId("map").addEventListener("keydown", (event) => {
    if (event.key === "Enter" || event.key === " ") pick(map.middle);
    else if (event.key === "Backspace" && asPath()) byId("undo").click();
    else if (event.key === "0") map.show();
    else return;
    event.preventDefault();
  });

  show("posterior", 0);
  tool("point");
  document.body.dataset.ready = "yes";
})();
