"use strict";
// Pieces of pages: what they hold unpacked, and elements whose words are text and never markup.
const Page = (() => {
  const byId = (id) => document.getElementById(id);
  async function gunzip(bytes) {
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }
  const unbase64 = (text) => Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const unpack = (id, page = document) => gunzip(unbase64(page.getElementById(id).textContent));
  const unpackJson = async (id, page) => JSON.parse(new TextDecoder().decode(await unpack(id, page)));

  // An element with text, or elements, in it.
  function element(name, content, attributes = {}) {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    for (const child of [content].flat()) made.append(child instanceof Node ? child : String(child ?? "–"));
    return made;
  }
  const figure = (value, digits, unit = "") => {
    if (typeof value !== "number") return "–";
    return value.toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits }) + unit;
  };
  // A table of names and values.
  function listed(rows) {
    return element(
      "table",
      element(
        "tbody",
        rows.map(([name, value]) => element("tr", [element("td", name), element("td", value)])),
      ),
    );
  }
  const press = (id, on) => byId(id).setAttribute("aria-pressed", String(on));
  // Buttons with data-NAME, of which one is pressed: returns what presses the one of a value.
  function choice(name, onClick) {
    const buttons = [...document.querySelectorAll(`[data-${name}]`)];
    for (const button of buttons) button.addEventListener("click", () => onClick(button.dataset[name]));
    return (value) => buttons.forEach((each) => each.setAttribute("aria-pressed", String(each.dataset[name] === value)));
  }
  function save(name, blob) {
    const link = element("a", "", { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1e4);
  }
  return { byId, choice, element, figure, gunzip, listed, press, save, unbase64, unpack, unpackJson };
})();
