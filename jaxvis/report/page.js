"use strict";
const root = document.documentElement;
const all = (selector, within = document) => [...within.querySelectorAll(selector)];
const one = (selector) => document.querySelector(selector);

/* Theme: the system's, until the reader chooses. */
const systemDark = matchMedia("(prefers-color-scheme: dark)");
one("#theme").addEventListener("click", () => {
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : systemDark.matches;
  root.dataset.theme = dark ? "light" : "dark";
});

/* Table: a click on a heading sorts by it, best first; missing values stay last. */
for (const heading of all("th")) {
  heading.querySelector("button").addEventListener("click", () => {
    const body = one("tbody");
    const column = heading.cellIndex;
    const first = heading.dataset.first;
    const order = heading.getAttribute("aria-sort") === first
      ? (first === "ascending" ? "descending" : "ascending") : first;
    all("th[aria-sort]").forEach((other) => other.removeAttribute("aria-sort"));
    heading.setAttribute("aria-sort", order);
    const sign = order === "ascending" ? 1 : -1;
    const key = (row) => row.cells[column]?.dataset.value ?? "";
    const compare = (a, b) => {
      const [x, y] = [key(a), key(b)];
      if (x === "" || y === "") return (x === "") - (y === "");
      const numeric = Number(x) - Number(y);
      return sign * (Number.isNaN(numeric) ? x.localeCompare(y) : numeric);
    };
    body.append(...all("tr", body).sort(compare));
  });
}

/* Side by side: hovering or clicking an image shows the reference in its place. */
const reference = one("#reference");
for (const pair of all(".pair[data-tag]")) {
  const over = new Image();
  over.src = reference.src;
  over.alt = "";
  over.className = "over";
  pair.append(over);
  pair.tabIndex = 0;
  pair.addEventListener("click", () => pair.classList.toggle("flipped"));
}

/* Stage: the reference on the left of an edge that follows the pointer, a method on the right. */
const stage = one("#stage");
if (stage) {
  const frame = one("#frame");
  const [back, front] = all("img", stage);
  const edge = one("#edge");
  const [leftTag, rightTag] = all(".tag", stage);
  const choices = all("#choices button");
  const modes = all("#modes button");
  const zooms = all("#zooms button");
  const state = { choice: 0, mode: "wipe", at: 0.5, flipped: false, zoom: "fit" };
  back.src = reference.src;

  const draw = () => {
    const card = document.getElementById(choices[state.choice].dataset.card);
    const name = choices[state.choice].textContent.trim();
    const image = card.querySelector(state.mode === "error" ? ".map img" : ".pair img");
    if (front.src !== image.src) front.src = image.src;
    const wipe = state.mode === "wipe";
    back.style.visibility = state.mode === "error" ? "hidden" : "";
    front.style.visibility = state.mode === "flip" && state.flipped ? "hidden" : "";
    front.style.clipPath = wipe ? `inset(0 0 0 ${100 * state.at}%)` : "";
    edge.hidden = !wipe;
    edge.style.left = `${100 * state.at}%`;
    leftTag.hidden = !wipe;
    leftTag.textContent = "reference";
    rightTag.textContent = state.mode === "error" ? `${name}: error`
      : state.mode === "flip" && state.flipped ? "reference" : name;
    stage.style.cursor = wipe ? "ew-resize" : state.mode === "flip" ? "pointer" : "default";
    choices.forEach((b, i) => b.setAttribute("aria-pressed", i === state.choice));
    modes.forEach((b) => b.setAttribute("aria-pressed", b.dataset.mode === state.mode));
    zooms.forEach((b) => b.setAttribute("aria-pressed", b.dataset.zoom === state.zoom));
    const [width, height] = [Number(stage.dataset.width), Number(stage.dataset.height)];
    const fit = Math.min(frame.clientWidth / width, (0.72 * innerHeight) / height);
    const scale = state.zoom === "fit" ? Math.max(fit, 0.1) : Number(state.zoom) / devicePixelRatio;
    stage.style.width = `${width * scale}px`;
    stage.style.height = `${height * scale}px`;
  };
  const set = (changes) => { Object.assign(state, changes); draw(); };

  choices.forEach((b, i) => b.addEventListener("click", () => set({ choice: i, flipped: false })));
  modes.forEach((b) => b.addEventListener("click", () => set({ mode: b.dataset.mode, flipped: false })));
  zooms.forEach((b) => b.addEventListener("click", () => set({ zoom: b.dataset.zoom })));
  stage.addEventListener("pointermove", (event) => {
    if (state.mode !== "wipe") return;
    const box = stage.getBoundingClientRect();
    set({ at: Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) });
  });
  stage.addEventListener("click", () => { if (state.mode === "flip") set({ flipped: !state.flipped }); });
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const digit = Number(event.key);
    if (digit >= 1 && digit <= choices.length) set({ choice: digit - 1, flipped: false });
    else if (event.key === "w") set({ mode: "wipe" });
    else if (event.key === "e") set({ mode: "error" });
    else if (event.key === "f") set({ mode: "flip", flipped: state.mode === "flip" && !state.flipped });
    else return;
    event.preventDefault();
  });
  addEventListener("resize", draw);
  draw();
}
