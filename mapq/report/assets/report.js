"use strict";
(async () => {
  const { byId, element, figure, listed, press } = Page,
    { measured } = Views;
  const [data, buffer] = await Promise.all([Page.unpackJson("data"), Page.unpack("scene")]),
    cut = data.threshold;
  const scene = new Views.Scene(data.scene, buffer);
  // Labels and p are those of all patches; the other columns have the patches listed, which may be fewer.
  const places = new Map(data.listed.map((number, place) => [number, place])),
    of = (column, patch) => column[places.get(patch)],
    measure = (name, patch) => of(data.measures[name], patch);
  const ROWS = 25,
    isPhone = matchMedia("(max-width: 640px)").matches,
    LABELS = ["plausible", "suspicious"],
    MARKS = ["●", "▲"];

  // How sure a label is, 0 at the threshold and 1 at the end of the scale.
  const sureness = (patch) => {
    const p = data.p[patch] ?? cut,
      bad = data.label[patch] === 1;
    return Math.min(1, Math.max(0, bad ? (p - cut) / Math.max(1 - cut, 1e-6) : (cut - p) / Math.max(cut, 1e-6)));
  };
  const look = {
    selected: -1,
    points: true,
    outlines: true,
    colour(patch) {
      const [pale, deep] = Views.palette()[LABELS[data.label[patch]]];
      return Views.mix(pale, deep, sureness(patch));
    },
    rank: (patch) => (data.label[patch] === 1 ? 2 + sureness(patch) : 1),
  };
  const views = [
    new Views.View(byId("plan"), scene, look, (patch) => select(patch), null, mark),
    new Views.View(byId("space"), scene, look, (patch) => select(patch), [-1.05, 0.6], mark),
  ];

  // ---- one patch in words; text of files is set by textContent alone
  const place = (values) => values.map((value) => (typeof value === "number" ? value.toFixed(2) : "–")).join(", ");
  function link(patch) {
    const made = element("button", `patch ${patch}`, { type: "button", class: "link" });
    made.addEventListener("click", () => select(patch));
    return made;
  }
  function reasonWords(words, other) {
    if (!places.has(other)) return [words];
    const parts = words.split(new RegExp(`(patch ${other}|neighbour ${other})(?![0-9])`));
    return parts.map((piece) => (piece === `patch ${other}` || piece === `neighbour ${other}` ? link(other) : piece));
  }
  function details(patch) {
    const label = LABELS[data.label[patch]],
      title = element("h3", `Patch ${patch}`),
      tag = element("p", [
        element("span", `${MARKS[data.label[patch]]} ${label}`, { class: `tag ${label}` }),
        ` probability ${figure(data.p[patch], 3)}`,
      ]);
    if (!places.has(patch)) {
      byId("details").replaceChildren(title, tag, element("p", "Not listed: the JSON of the result has its reasons."));
      return;
    }
    const rows = [
      ...measured((name) => measure(name, patch)),
      ["normal", of(data.normal, patch).map((x) => figure(x, 3)).join(", ")],
      ["centre", place(of(data.centre, patch)) + " m"],
    ];
    const [apart, low, high] = of(data.apart, patch);
    if (apart !== null)
      rows.push(["scans disagree", `${figure(apart, 2)} m (${figure(low, 2)} to ${figure(high, 2)})`]);
    if (data.shift)
      rows.push(["centre, world", place(of(data.centre, patch).map((x, axis) => x + data.shift[axis])) + " m"]);
    const region = of(data.region, patch);
    if (region !== null) rows.push(["region", region]);
    const reasons = of(data.reasons, patch).map(([words, odds, other]) =>
      element("li", [...reasonWords(words, other), element("small", ` ${odds > 0 ? "+" : ""}${odds}`)]),
    );
    const cause = of(data.cause, patch),
      more = element("details", [element("summary", element("h4", "Measured")), listed(rows)]);
    more.open = !isPhone;
    byId("details").replaceChildren(
      title,
      tag,
      element("h4", `Why it is called ${label}`),
      reasons.length
        ? element("ol", reasons, { id: "reasons" })
        : element("p", "Nothing in particular: no feature favours its label.", { class: "note" }),
      ...(cause ? [element("h4", "Cause"), element("p", `${cause[0]}: ${cause[1]}`)] : []),
      more,
    );
  }

  // ---- selection, the same in every view
  function select(patch, fromTable = false) {
    look.selected = patch;
    details(patch);
    if (!fromTable && places.has(patch)) showRow(patch);
    for (const row of document.querySelectorAll("tr[data-patch]"))
      row.setAttribute("aria-selected", String(+row.dataset.patch === patch));
    for (const row of document.querySelectorAll("tr[data-region]"))
      row.setAttribute("aria-selected", String(row.dataset.region === String(of(data.region, patch))));
    for (const view of views) view.draw();
  }
  const toViews = () => document.querySelector(".stage").scrollIntoView({ block: "nearest" });
  function goTo(box) {
    for (const view of views) view.show(box);
  }

  // ---- distances, between two clicks into a view
  function mark(view, place) {
    const { marks } = look,
      goesOn = marks?.view === view && marks.places.length === 1;
    look.marks = { view, places: goesOn ? [marks.places[0], place] : [place] };
    const [length] = Canvas.legsOf(look.marks.places);
    byId("measured").textContent = length === undefined ? "… to the second place" : `${figure(length, 2)} m${view.eye ? "" : " in plan"}`;
    for (const each of views) each.draw();
  }
  byId("measure").addEventListener("click", () => {
    look.measuring = !look.measuring;
    look.marks = null;
    press("measure", look.measuring);
    byId("measured").textContent = look.measuring ? "click two places" : "";
    for (const each of views) each.draw();
  });

  // ---- the table of patches
  const largestFirst = (name, value, digits, kind = "number folds") => [
    name,
    (patch) => -(value(patch) ?? -1),
    (patch) => figure(value(patch), digits),
    kind,
  ];
  const squareMetres = (area) => figure(area, area < 0.1 ? 2 : 1);
  const columns = [
    ["patch", (patch) => patch, (patch) => patch, "number"],
    ["label", (patch) => -data.label[patch], null, "label"],
    largestFirst("p", (patch) => data.p[patch], 3, "number"),
    ["area m²", (patch) => -(measure("area_m2", patch) ?? -1), (patch) => squareMetres(measure("area_m2", patch)), "number folds"],
    largestFirst("width m", (patch) => measure("width_m", patch), 1),
    largestFirst("height m", (patch) => measure("height_m", patch), 1),
    largestFirst("rms m", (patch) => measure("rms_m", patch), 3),
    ["region", (patch) => of(data.region, patch) ?? 1e9, (patch) => of(data.region, patch) ?? "–", "number folds"],
    ["main reason", null, (patch) => of(data.reasons, patch)[0]?.[0] ?? "–", ""],
  ];
  let order = [],
    from = 0,
    sorted = -1,
    upward = true;
  const severity = (patch) => (data.p[patch] ?? 0) * (measure("area_m2", patch) ?? measure("n_points", patch));
  function worstFirst(a, b) {
    return data.label[b] - data.label[a] || severity(b) - severity(a) || a - b;
  }
  function arrange() {
    const wanted = byId("find").value.trim(),
      only = byId("only").checked;
    order = data.listed.filter(
      (patch) => (!only || data.label[patch] === 1) && (!wanted || String(patch).startsWith(wanted)),
    );
    const key = sorted < 0 ? null : columns[sorted][1];
    order.sort(key ? (a, b) => (upward ? 1 : -1) * (key(a) - key(b)) || a - b : worstFirst);
    from = 0;
    [...byId("names").children].forEach((head, place) =>
      head.setAttribute("aria-sort", place !== sorted ? "none" : upward ? "ascending" : "descending"),
    );
    list();
  }
  function list() {
    byId("rows").replaceChildren(
      ...order.slice(from, from + ROWS).map((patch) => {
        const row = element(
          "tr",
          columns.map(([, , shown, kind]) => cell(patch, shown, kind)),
          { tabindex: "0", "data-patch": patch, "aria-selected": String(patch === look.selected) },
        );
        row.addEventListener("click", () => {
          select(patch, true);
          toViews();
        });
        return row;
      }),
    );
    byId("page").textContent = order.length
      ? `${from + 1} to ${Math.min(from + ROWS, order.length)} of ${order.length.toLocaleString("en")}`
      : "none";
    byId("back").disabled = from === 0;
    byId("more").disabled = from + ROWS >= order.length;
  }
  function cell(patch, shown, kind) {
    if (shown) return element("td", shown(patch), { class: kind });
    const swatch = element("span", "", { class: "swatch" });
    swatch.style.background = Views.css(look.colour(patch));
    return element("td", [swatch, `${MARKS[data.label[patch]]}\u00a0${LABELS[data.label[patch]]}`], { class: kind });
  }
  function showRow(patch) {
    let place = order.indexOf(patch);
    if (place < 0) {
      byId("only").checked = false;
      byId("find").value = "";
      arrange();
      place = order.indexOf(patch);
    }
    if (place < from || place >= from + ROWS) {
      from = place - (place % ROWS);
      list();
    }
  }
  function step(by) {
    if (!order.length) return;
    const place = order.indexOf(look.selected),
      next = order[Math.min(order.length - 1, Math.max(0, place < 0 ? 0 : place + by))];
    select(next);
  }
  byId("names").append(
    ...columns.map(([name, key, , kind], place) => {
      if (!key) return element("th", name, { scope: "col" });
      const head = element("th", name, {
        scope: "col",
        tabindex: "0",
        title: "sort by it",
        class: kind,
      });
      head.addEventListener("click", () => {
        upward = sorted === place ? !upward : true;
        sorted = place;
        arrange();
      });
      return head;
    }),
  );
  byId("only").addEventListener("change", arrange);
  byId("find").addEventListener("input", arrange);
  byId("back").addEventListener("click", () => {
    from = Math.max(0, from - ROWS);
    list();
  });
  byId("more").addEventListener("click", () => {
    from += ROWS;
    list();
  });

  // ---- regions
  for (const row of document.querySelectorAll("tr[data-region]")) {
    row.addEventListener("click", () => {
      const region = data.regions[+row.dataset.region],
        patches = region.filter((patch) => places.has(patch));
      goTo(scene.boxOf(region));
      toViews();
      if (patches.length) select(patches.reduce((a, b) => (worstFirst(a, b) <= 0 ? a : b)));
    });
  }

  // ---- buttons and keys
  function legend() {
    const { plausible, suspicious } = Views.palette(),
      bar = ([first, last]) => {
        const made = element("i", "");
        made.style.background = `linear-gradient(90deg, ${Views.css(first)}, ${Views.css(last)})`;
        return made;
      };
    const dot = element("i", "", { class: "dot" });
    dot.style.background = "var(--map-loose)";
    byId("legend").replaceChildren(
      element("span", ["● plausible, p 0", bar([plausible[1], plausible[0]]), figure(cut, 2)]),
      element("span", [`▲ suspicious, p ${figure(cut, 2)}`, bar(suspicious), "1"]),
      element("span", [dot, "no patch"]),
    );
  }
  function repaint() {
    legend();
    list();
    press("palette", document.body.dataset.palette === "colour-blind");
    for (const view of views) view.draw();
  }
  addEventListener("themechange", repaint);
  byId("palette").addEventListener("click", () => {
    document.body.dataset.palette = document.body.dataset.palette === "colour-blind" ? "blue-red" : "colour-blind";
    repaint();
  });
  for (const name of ["points", "outlines"]) {
    byId(name).addEventListener("click", () => {
      look[name] = !look[name];
      press(name, look[name]);
      repaint();
    });
  }
  const near = () => {
    if (look.selected >= 0) goTo(scene.boxOf([look.selected]));
  };
  byId("whole").addEventListener("click", () => goTo());
  byId("near").addEventListener("click", near);
  byId("before").addEventListener("click", () => step(-1));
  byId("after").addEventListener("click", () => step(1));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.matches("input, button")) return;
    const row = event.target.closest?.("tr[tabindex]"),
      head = event.target.closest?.("th[tabindex]");
    if ((row || head) && (event.key === "Enter" || event.key === " ")) (row || head).click();
    else if (row && event.key === "ArrowDown") (row.nextElementSibling || row).focus();
    else if (row && event.key === "ArrowUp") (row.previousElementSibling || row).focus();
    else if (event.key === "j") step(1);
    else if (event.key === "k") step(-1);
    else if (event.key === "f") near();
    else if (event.key === "0") goTo();
    else return;
    event.preventDefault();
  });

  // ---- telephones: all but the views is folded, until it is asked for
  const fold = (away) => document.querySelectorAll("details").forEach((part) => (part.open = !away));
  if (isPhone) fold(true);

  // ---- paper: both views as pictures, at the density of a printer
  let backToScreen = [];
  window.addEventListener("beforeprint", () => {
    fold(false);
    backToScreen = views.map((view) => view.print([695, 320]));
  });
  window.addEventListener("afterprint", () => {
    for (const back of backToScreen) back();
    backToScreen = [];
  });

  arrange();
  legend();
  if (order.length) select(order[0]);
  document.body.dataset.ready = "yes";
})();
