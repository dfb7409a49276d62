"use strict";
(async () => {
  const { byId, element, figure, listed, press } = Page,
    { measured } = Views;
  const NOTHING = 254,
    WORDS = { 0: "plausible", 1: "suspicious", 255: "unsure" },
    CODES = { plausible: 0, suspicious: 1, unsure: 255 };
  const TARGET = [224, 0, 122],
    TINTS = [
      [31, 98, 184],
      [0, 140, 110],
      [130, 80, 190],
      [196, 120, 0],
      [0, 150, 190],
      [120, 140, 30],
      [90, 90, 160],
      [160, 90, 60],
      [40, 120, 60],
      [110, 110, 110],
    ];
  const token = new URLSearchParams(location.search).get("token") || "";

  async function ask(path, given) {
    const options = { headers: { "X-Page-Token": token }, cache: "no-store" };
    if (given) {
      options.method = "POST";
      options.headers["Content-Type"] = "application/json";
      options.body = JSON.stringify(given);
    }
    let answer;
    try {
      answer = await fetch(path, options);
    } catch {
      throw new Error("mapq does not answer any more: start it again. Every label counted above is kept.");
    }
    const kind = answer.headers.get("Content-Type") || "";
    const found = kind.startsWith("application/json") ? await answer.json() : { error: (await answer.text()).trim() };
    if (!answer.ok) throw new Error(found.error || answer.statusText);
    return found;
  }
  function trouble(error) {
    byId("trouble").hidden = !error;
    byId("trouble").textContent = error ? error.message : "";
  }

  let state;
  try {
    state = await ask("/api/state");
  } catch (error) {
    trouble(error);
    return;
  }
  const said = state.said,
    n = said.length,
    visited = [],
    cache = new Map();
  let place = -1,
    busy = false,
    space = null,
    plan = null,
    scene = null,
    shown = null,
    hidden = false;

  // ---- looks: the patch in one strong colour, its neighbours in others, the rest grey
  const tint = (index) => (index === 0 ? TARGET : TINTS[(index - 1) % TINTS.length]);
  const look = {
    selected: 0,
    points: true,
    outlines: true,
    mark: { points: TARGET, line: [150, 0, 82] },
    colour: tint,
    rank: (index) => (index === 0 ? 9 : 1 - index / 1e3),
  };

  function fetchPatch(patch) {
    if (!cache.has(patch)) {
      cache.set(patch, ask(`/api/patch/${patch}`));
      if (cache.size > 12) cache.delete(cache.keys().next().value);
    }
    return cache.get(patch);
  }
  const nextOpen = (after) => state.order.find((patch) => said[patch] === NOTHING && patch !== after);

  async function show(patch) {
    busy = true;
    try {
      const found = await fetchPatch(patch);
      const buffer = await Page.gunzip(Page.unbase64(found.content));
      scene = new Views.Scene(found.scene, buffer);
      shown = found;
      const box = scene.boxOf([0]);
      if (!plan) {
        plan = new Views.View(byId("plan"), scene, look, pickNeighbour);
        space = new Views.View(byId("space"), scene, look, pickNeighbour, eyeTo(found.normal));
      } else {
        plan.set(scene);
        space.set(scene);
      }
      space.eye = eyeTo(found.normal);
      plan.show(box);
      space.show(box);
      describe();
      trouble(null);
      const next = nextOpen(patch);
      if (next !== undefined) fetchPatch(next).catch(() => cache.delete(next));
    } catch (error) {
      cache.delete(patch);
      trouble(error);
    } finally {
      busy = false;
      document.body.dataset.patch = String(patch);
    }
  }
  // From where to look: at the face of the patch, from aside and above, so that what lies behind it shows.
  function eyeTo([x, y, z]) {
    const flat = Math.hypot(x, y),
      turn = flat > 0.3 ? Math.atan2(y, x) + 0.6 : -1;
    return [turn, 0.5 + 0.3 * Math.abs(z)];
  }
  function pickNeighbour(index) {
    if (index > 0 && shown && !busy) go(shown.neighbours[index - 1].patch);
  }

  // ---- words; everything by textContent
  function key(index) {
    const made = element("span", "", { class: "key" });
    made.style.background = Views.css(tint(index));
    return made;
  }
  function describe() {
    const patch = shown.patch;
    byId("name").replaceChildren(key(0), `Patch ${patch}`);
    const rows = [
      ...measured((name) => shown.measures[name]),
      ["centre, world", shown.centre.map((x) => x.toFixed(2)).join(", ") + " m"],
    ];
    const opinion =
      shown.p === null
        ? []
        : [
            element("h4", "What the model says", { class: "model" }),
            element(
              "p",
              `${WORDS[shown.model_label]}: probability ${figure(shown.p, 3)}, suspicious from ${figure(state.threshold, 2)} on`,
              { class: "model" },
            ),
            element(
              "ul",
              shown.reasons.map(([words, odds]) =>
                element("li", [
                  words,
                  element("small", ` ${odds > 0 ? "+" : ""}${odds} for ${odds > 0 ? "suspicious" : "plausible"}`),
                ]),
              ),
              { class: "model", id: "reasons" },
            ),
          ];
    const neighbours = shown.neighbours.map((row, index) => {
      const jump = element("button", `patch ${row.patch}`, { type: "button", class: "link" });
      jump.addEventListener("click", () => go(row.patch));
      const hand = said[row.patch] === NOTHING ? "" : `, you said ${WORDS[said[row.patch]]}`;
      const p = row.p === null ? "" : element("span", `, p ${figure(row.p, 2)}`, { class: "model" });
      return element("li", [
        key(index + 1),
        jump,
        p,
        hand,
        element("br", []),
        element("small", row.text || "close by"),
      ]);
    });
    byId("details").replaceChildren(
      ...opinion,
      element("h4", "Measured"),
      listed(rows),
      element("h4", "Neighbours"),
      element("ul", neighbours, { id: "neighbours" }),
    );
    sayLabel();
  }
  function sayLabel() {
    if (!shown) return;
    const now = said[shown.patch],
      field = state.from_field[shown.patch];
    const words =
      now === NOTHING
        ? field === NOTHING
          ? "not labelled yet"
          : `labelled ${WORDS[field]} by a point field`
        : `you said ${WORDS[now]}`;
    byId("said").replaceChildren(
      element("span", words, { class: `tag ${now === 0 ? "plausible" : now === 1 ? "suspicious" : "none"}` }),
    );
    for (const [word, code] of Object.entries(CODES)) press(word, now === code);
  }
  function progress(given) {
    const counts = given.counts,
      share = (count) => `${(100 * count) / Math.max(n, 1)}%`;
    byId("counts").textContent =
      `${counts.n_by_hand} of ${counts.n_patches} labelled: ${counts.n_plausible} plausible, ` +
      `${counts.n_suspicious} suspicious, ${counts.n_unsure} unsure`;
    for (const [name, count] of [
      ["p", counts.n_plausible],
      ["s", counts.n_suspicious],
      ["u", counts.n_unsure],
    ])
      byId("meter").querySelector(`.${name}`).style.width = share(count);
    byId("meter").setAttribute("aria-valuemax", n);
    byId("meter").setAttribute("aria-valuenow", counts.n_by_hand);
    byId("undo").disabled = !given.can_undo;
    byId("back").disabled = place <= 0;
    byId("forward").disabled = nextOpen(visited[place]) === undefined && place >= visited.length - 1;
    document.body.dataset.done = String(counts.n_by_hand);
    state.last = given;
  }

  // ---- moving and labelling
  async function go(patch) {
    visited.splice(place + 1, visited.length, patch);
    place = visited.length - 1;
    await show(patch);
    progress(state.last);
  }
  async function forward() {
    if (place < visited.length - 1) {
      place += 1;
      await show(visited[place]);
      progress(state.last);
      return;
    }
    const next = nextOpen(visited[place]);
    if (next !== undefined) await go(next);
    else saved("every patch is labelled");
  }
  async function back() {
    if (place <= 0) return;
    place -= 1;
    await show(visited[place]);
    progress(state.last);
  }
  function saved(words) {
    byId("saved").textContent = words;
    clearTimeout(saved.timer);
    saved.timer = setTimeout(() => {
      byId("saved").textContent = "";
    }, 2500);
  }
  async function label(word) {
    if (busy || !shown) return;
    busy = true;
    try {
      const answer = await ask("/api/label", { patch: shown.patch, label: word });
      said[shown.patch] = answer.said;
      trouble(null);
      sayLabel();
      progress(answer);
      saved("saved");
    } catch (error) {
      trouble(error);
      return;
    } finally {
      busy = false;
    }
    await forward();
  }
  async function undo() {
    if (busy) return;
    busy = true;
    let answer;
    try {
      answer = await ask("/api/undo", {});
      trouble(null);
    } catch (error) {
      trouble(error);
      return;
    } finally {
      busy = false;
    }
    if (answer.patch === null) {
      saved("nothing to undo");
      return;
    }
    said[answer.patch] = answer.said;
    const before = visited.lastIndexOf(answer.patch, place);
    if (before >= 0) {
      place = before;
      await show(answer.patch);
    } else await go(answer.patch);
    progress(answer);
    saved("taken back");
  }
  async function finish() {
    if (busy) return;
    busy = true;
    try {
      await ask("/api/finish", {});
      document.body.dataset.ended = "yes";
      for (const button of document.querySelectorAll("button")) button.disabled = true;
      saved.timer && clearTimeout(saved.timer);
      byId("saved").textContent = "Stored. This page can be closed.";
    } catch (error) {
      trouble(error);
      busy = false;
    }
  }
  function hide() {
    hidden = !hidden;
    document.body.classList.toggle("hidden-model", hidden);
    press("blind", hidden);
  }
  const actions = {
    p: () => label("plausible"),
    s: () => label("suspicious"),
    u: () => label("unsure"),
    z: undo,
    Backspace: undo,
    ArrowLeft: back,
    ArrowRight: forward,
    h: hide,
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.repeat || !actions[event.key]) return;
    event.preventDefault();
    if (!busy) actions[event.key]();
  });
  for (const word of Object.keys(CODES)) byId(word).addEventListener("click", () => label(word));
  byId("undo").addEventListener("click", undo);
  byId("back").addEventListener("click", back);
  byId("forward").addEventListener("click", forward);
  byId("finish").addEventListener("click", finish);
  byId("blind").addEventListener("click", hide);

  state.last = state;
  const first = nextOpen(-1) ?? state.order[0];
  await go(first);
  if (state.counts.n_by_hand === n) saved("every patch is labelled");
  document.body.dataset.ready = "yes";
})();
