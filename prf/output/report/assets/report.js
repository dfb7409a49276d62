"use strict";
(async () => {
  const LAYERS = ["outline", "path", "ellipses", "given", "readings", "differs", "places"];
  const { byId, choice, element, figure, press } = Page;
  const look = { base: "posterior", draw: 0, tool: "point", corners: [], radius: 0.25 };
  let data, draws, scene, order;
  // Takes the content of a page: of this one, or of a later one of a run under way.
  async function take(page) {
    const [head, drawn, cells, numbers] = await Promise.all([
      Page.unpackJson("data", page),
      ...["draws", "cells", "scene"].map((id) => Page.unpack(id, page)),
    ]);
    data = head;
    draws = new Prf.Draws(data.draws, drawn, data.window, data.step);
    const whole = Prf.whole(numbers);
    let place = 0;
    scene = {};
    for (const [name, size] of Object.entries(data.scene)) scene[name] = whole.subarray(place, (place += size));
    // Neighbours on the slider are draws of different chains.
    order = [...Array(draws.n).keys()].sort(
      (a, b) => a - draws.starts[draws.chainOf(a)] - (b - draws.starts[draws.chainOf(b)]) || a - b,
    );
    return [data, draws, new Uint8Array(cells), scene];
  }
  const content = await take(document);
  // A path that was sampled is what to look at.
  byId("path").checked ||= scene.given.length > 0;
  for (const name of LAYERS) look[name] = byId(name).checked;
  const map = new Prf.Map(byId("map"), content, look, pick);

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
  byId("draw").addEventListener("input", () => show("draw"));
  const pressBase = choice("base", (base) => {
    play(false);
    show(base);
  });
  for (const name of LAYERS)
    byId(name).addEventListener("change", () => {
      look[name] = byId(name).checked;
      map.draw();
    });
  // What there is to show and to choose from.
  function offer() {
    const has = {
      outline: scene.best.length,
      path: scene.path.length,
      ellipses: scene.ellipses.length,
      given: scene.given.length,
      readings: scene.returns.length + scene.arcs.length + scene.points.length,
      differs: map.difference.some((_, cell) => map.differs(cell)),
      places: data.places.length,
    };
    for (const name of LAYERS) byId(name).parentElement.hidden = !has[name];
    byId("draw").max = draws.n - 1;
    byId("geojson").disabled = document.querySelector("[data-base=best]").disabled = !map.best;
    document.querySelector("[data-base=returns]").hidden = !data.cells.square;
  }
  byId("whole").addEventListener("click", () => map.show());
  document.addEventListener("click", ({ target }) => {
    if (!target.dataset?.place) return;
    const [x, y, side] = target.dataset.place.split(",").map(Number),
      reach = Math.max(1.5, 2 * side);
    map.show([x - reach, y - reach, x + reach, y + reach]);
    byId("map").scrollIntoView({ block: "nearest" });
  });
  byId("geojson").addEventListener("click", () =>
    Page.save(`${data.name}.geojson`, new Blob([data.map], { type: "application/geo+json" })),
  );
  byId("png").addEventListener("click", () => byId("map").toBlob((blob) => Page.save(`${data.name}.png`, blob)));

  // ---- questions
  const note = { class: "note" },
    metres = (value) => String(+value.toFixed(3)),
    asPath = () => look.tool === "path",
    isLine = () => look.tool !== "point";
  const GIVES = {
    point: "How probably a place is occupied, with bounds of the error.",
    path: "How probably a disc can follow a path, with bounds of the error, and a draw in which it cannot.",
    length: "The distance of places, or the length of a line through them.",
  };
  const HINTS = {
    point: "Click the map, or give x, y in metres",
    path: "Click the corners of the path, or give them: x, y; x, y",
    length: "Click two places or more, or give them: x, y; x, y",
  };
  function tool(name) {
    look.tool = name;
    if (!isLine()) look.corners = look.corners.slice(-1);
    pressTool(name);
    byId("disc").hidden = !asPath();
    byId("drawing").hidden = !isLine();
    byId("hint").textContent = HINTS[name];
    ask(true);
  }
  function pick(point) {
    look.corners = isLine() ? [...look.corners, point] : [point];
    ask(true);
  }
  // written: whether the field of coordinates is to follow the map.
  function ask(written) {
    if (written) byId("where").value = look.corners.map((point) => point.map(metres).join(", ")).join("; ");
    look.corners = parsed(byId("where").value).slice(isLine() ? 0 : -1);
    byId("metres").textContent = figure(look.radius, 2, " m");
    byId("undo").disabled = byId("clear").disabled = !look.corners.length;
    map.draw();
    const isWrong = byId("where").value.trim(),
      wrong = [isWrong ? element("p", "These are no coordinates: give x, y in metres.") : element("p", GIVES[look.tool], note)];
    byId("answer").replaceChildren(...(look.corners.length ? answer() : wrong));
  }
  function parsed(text) {
    const pairs = text.split(/[;\n]/).map((pair) => pair.trim().split(/[\s,]+/).map(Number));
    return pairs.every((pair) => pair.length === 2 && pair.every(Number.isFinite)) ? pairs : [];
  }
  function length() {
    const legs = Canvas.legsOf(look.corners);
    if (!legs.length) return [element("p", "From here; a second place gives the distance.", note)];
    const total = legs.reduce((sum, leg) => sum + leg, 0),
      words = legs.length > 1 ? ` along ${legs.length} legs, the last of ${figure(legs.at(-1), 2)} m` : " from place to place";
    return [element("p", [element("strong", figure(total, 2, " m"), { id: "total" }), words])];
  }
  function answer() {
    if (look.tool === "length") return length();
    if (!look.corners.every((point) => draws.inside(point)))
      return [element("p", "Outside the window: nothing is known there.")];
    const event = asPath() ? draws.clearAlong(look.corners, look.radius) : draws.blackAt(look.corners[0]),
      nearEss = draws.essNear(look.corners, asPath() ? look.radius : 0),
      found = Prf.estimate(event, draws.starts, draws.smallestEss, nearEss),
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
    else if (event.key === "Backspace" && isLine()) byId("undo").click();
    else if (event.key === "0") map.show();
    else return;
    event.preventDefault();
  });

  // ---- a run under way
  async function follow() {
    const headers = { "X-Page-Token": new URLSearchParams(location.search).get("token") };
    while (data.edition) {
      await new Promise((done) => setTimeout(done, 2000));
      const answer = await fetch(`after/${data.edition}`, { headers }).catch(() => null);
      if (!answer) return tell("The program that made this page has ended, and the page stays as it was.");
      if (answer.status === 200) await renew(new DOMParser().parseFromString(await answer.text(), "text/html"));
    }
    tell("The run has ended; this page is complete.");
  }
  const tell = (words) => (document.querySelector("[data-live=state]").textContent = words);
  async function renew(page) {
    map.set(...(await take(page)));
    for (const part of document.querySelectorAll("[data-live]"))
      part.replaceChildren(...page.querySelector(`[data-live=${part.dataset.live}]`).childNodes);
    offer();
    show(look.base, Math.min(+byId("draw").value, draws.n - 1));
    ask(false);
  }

  offer();
  show("posterior", 0);
  tool("point");
  document.body.dataset.ready = "yes";
  if (data.edition) follow();
})();
