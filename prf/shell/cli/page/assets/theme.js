"use strict";
// Light or dark as the system has it, until the button of the page says otherwise; runs before anything is drawn.
const Theme = (() => {
  const root = document.documentElement,
    system = matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  const isDark = () => root.dataset.theme === "dark";
  function set(dark) {
    root.dataset.theme = dark ? "dark" : "light";
    document.getElementById("theme")?.setAttribute("aria-pressed", String(dark));
    dispatchEvent(new Event("themechange"));
  }
  system.addEventListener("change", () => set(chosen ?? system.matches));
  set(system.matches);
  document.addEventListener("DOMContentLoaded", () => {
    document.getElementById("theme").addEventListener("click", () => set((chosen = !isDark())));
    set(isDark());
  });
  // Paper is white: the listeners of a page run after this one, and find the colours of light.
  addEventListener("beforeprint", () => set(false));
  addEventListener("afterprint", () => set(chosen ?? system.matches));
  const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim(),
    rgb = (name) => colour(name).match(/[0-9a-f]{2}/gi).map((two) => parseInt(two, 16));
  return { isDark, colour, rgb };
})();
