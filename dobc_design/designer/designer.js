// The drawing and the sliders. Everything that is a number comes from the kernel; nothing is loaded from anywhere.
const SVG = "http://www.w3.org/2000/svg";
const SIZE = 380, MARGIN = 34, REST = 700; // px, px, ms without a move until the exact verdict is asked for
const MOST_SLIDERS = 40, PATIENCE = 15000; // ms without a word from the kernel until the page says so
const LOST = "The kernel does not answer; after a restart, run this cell again. Moves since the last estimates are not in the problem.";

function made(parent, name, attributes = {}, text = "") {
  const element = name.startsWith("svg:")
    ? document.createElementNS(SVG, name.slice(4)) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text) element.textContent = text;
  parent.appendChild(element);
  return element;
}

function digits(value, count = 4) {
  if (value === null || value === undefined) return "";
  return Math.abs(value) < 1e-12 ? "0" : Number(value).toPrecision(count).replace(/\.?0+(e|$)/, "$1");
}

function drawNetwork(holder, model, toggle) {
  const { labels, places, arcs } = model.get("network");
  const svg = made(holder, "svg:svg", { viewBox: `0 0 ${SIZE} ${SIZE}`, role: "group",
    "aria-label": "Network: activate an agent to pin it or to let it go" });
  const id = `tip${Math.random().toString(36).slice(2)}`;
  const marker = made(made(svg, "svg:defs"), "svg:marker", { id, viewBox: "0 0 8 8", refX: 8, refY: 4,
    markerWidth: 7, markerHeight: 7, orient: "auto" });
  made(marker, "svg:path", { d: "M0 1 L8 4 L0 7 z", class: "dobc-tip" });
  const size = labels.length > 60 ? 7 : labels.length > 25 ? 11 : 15;
  const at = (k) => places[k].map((c, axis) => SIZE / 2 + (axis ? -1 : 1) * c * (SIZE / 2 - MARGIN));
  for (const [listener, speaker] of arcs) { // information runs from the speaker to the listener
    const [x1, y1] = at(speaker), [x2, y2] = at(listener);
    const length = Math.hypot(x2 - x1, y2 - y1) || 1;
    const cut = (size + 2) / length;
    made(svg, "svg:line", { x1: x1 + (x2 - x1) * cut, y1: y1 + (y2 - y1) * cut, x2: x2 - (x2 - x1) * cut,
      y2: y2 - (y2 - y1) * cut, class: "dobc-arc", "marker-end": `url(#${id})` });
  }
  const agents = labels.map((label, k) => {
    const [x, y] = at(k);
    const group = made(svg, "svg:g", { tabindex: 0, role: "button", class: "dobc-agent", "data-agent": label });
    made(group, "svg:circle", { cx: x, cy: y, r: size });
    made(group, "svg:text", { x, y, dy: "0.35em" }, label.length <= 3 ? label : label.slice(0, 2) + "…");
    made(group, "svg:title", {}, label);
    group.addEventListener("click", () => toggle(label));
    group.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); toggle(label); }
    });
    return group;
  });
  return () => labels.forEach((label, k) => {
    const gain = model.get("gains")[label];
    agents[k].classList.toggle("dobc-pinned", gain !== undefined);
    agents[k].setAttribute("aria-pressed", gain !== undefined);
    agents[k].setAttribute("aria-label", `agent ${label}, ${gain === undefined ? "not pinned" : `gain ${digits(gain)}`}`);
  });
}

function drawResponse(holder) {
  const width = 380, height = 200, left = 46, bottom = 36;
  const svg = made(holder, "svg:svg", { viewBox: `0 0 ${width} ${height}`, role: "img",
    "aria-label": "Distance of every agent from its goal over time, without disturbances" });
  return (numbers, radius) => {
    svg.replaceChildren();
    const { times, errors } = numbers;
    const x = (t) => left + (width - left - 8) * t / (times[times.length - 1] || 1);
    const top = 1.05 * Math.max(radius, ...errors.map((row) => Math.max(...row)), 1e-12);
    const y = (e) => height - bottom - (height - bottom - 8) * Math.min(e, top) / top;
    made(svg, "svg:line", { x1: left, y1: y(0), x2: width - 8, y2: y(0), class: "dobc-axis" });
    made(svg, "svg:line", { x1: left, y1: y(0), x2: left, y2: y(top), class: "dobc-axis" });
    for (const value of [0, radius]) made(svg, "svg:text", { x: left - 5, y: y(value), dy: "0.35em",
      "text-anchor": "end" }, digits(value, 3));
    if (times.length) {
      made(svg, "svg:text", { x: width - 8, y: height - 20, "text-anchor": "end" }, `${digits(times[times.length - 1], 3)} s`);
      for (const row of errors) made(svg, "svg:polyline", { class: "dobc-curve",
        points: row.map((e, k) => `${x(times[k]).toFixed(1)},${y(e).toFixed(1)}`).join(" ") });
    }
    made(svg, "svg:text", { x: left, y: height - 5 }, "|x_i − goal_i| over time, network alone");
  };
}

function slider(parent, text, unit, [low, high], get, set) {
  // A logarithmic scale: the hand says a factor.
  const row = made(parent, "label", { class: "dobc-row" });
  made(row, "span", {}, text);
  const input = made(row, "input", { type: "range", min: 0, max: 1000 });
  const shown = made(row, "output");
  const place = (value) => 1000 * Math.log(value / low) / Math.log(high / low);
  input.addEventListener("input", () => {
    const value = Number((low * (high / low) ** (input.value / 1000)).toPrecision(3));
    shown.textContent = `${digits(value)} ${unit}`;
    set(value);
  });
  return () => {
    if (document.activeElement !== input) input.value = place(Math.min(high, Math.max(low, get())));
    shown.textContent = `${digits(get())} ${unit}`;
  };
}

function render({ model, el }) {
  el.classList.add("dobc-designer");
  let waiting = null, rest = null, pending = false, lost = null;
  const expect = () => { // the kernel may be gone: what stands here would wait for ever
    clearTimeout(lost);
    lost = setTimeout(() => {
      pending = false;
      verdict.className = "dobc-verdict dobc-error";
      verdict.textContent = LOST;
    }, PATIENCE);
  };
  const rested = () => {
    clearTimeout(rest);
    rest = setTimeout(() => { model.send({ kind: "certify", version: model.get("version") }); expect(); }, REST);
  };
  const flush = () => { // at most one question is under way; what was moved meanwhile goes with the next one
    if (pending || !waiting) return;
    for (const [key, value] of Object.entries(waiting)) model.set(key, value);
    waiting = null;
    pending = true;
    expect();
    model.save_changes();
  };
  const move = (key, value) => {
    if (JSON.stringify(model.get(key)) === JSON.stringify(value)) return;
    waiting = { ...waiting, [key]: value };
    verdict.className = "dobc-verdict dobc-moving";
    verdict.textContent = "The exact verdict comes when you rest.";
    clearTimeout(rest);
    flush();
  };
  const current = (key) => (waiting && key in waiting ? waiting[key] : model.get(key));
  const toggle = (label) => {
    const gains = { ...current("gains") };
    if (label in gains) delete gains[label]; else gains[label] = model.get("network").gain;
    move("gains", gains);
  };

  const left = made(el, "div", { class: "dobc-left" }), right = made(el, "div", { class: "dobc-right" });
  made(left, "div", { class: "dobc-title" }, model.get("network").name);
  const network = drawNetwork(left, model, toggle);
  made(left, "div", { class: "dobc-hint" }, "Click an agent to pin it to the target, again to let it go. Arrows show who is heard by whom.");

  const verdict = made(right, "div", { class: "dobc-verdict", role: "status", "aria-live": "polite" });
  const numbers = made(right, "div", { class: "dobc-numbers" });
  const start = Math.max(model.get("radius"), 1e-3);
  const fixed = [
    slider(right, "starts within", "of the target", [start / 50, start * 50], () => current("radius"), (v) => move("radius", v)),
    slider(right, "preview at rate", "1/s", [0.001, 10], () => current("rate"), (v) => move("rate", v)),
  ];
  const gains = made(right, "div", { class: "dobc-gains" });
  const response = drawResponse(right);
  const saving = made(right, "div", { class: "dobc-row" });
  const path = made(saving, "input", { type: "text", value: `${model.get("network").name}-designed.toml`, "aria-label": "Name of the problem file" });
  const save = made(saving, "button", {}, "Save as problem file");
  const again = made(saving, "label");
  const replace = made(again, "input", { type: "checkbox" });
  again.append(" replace");
  const saved = made(right, "div", { class: "dobc-hint", role: "status" });
  save.addEventListener("click", () => model.send({ kind: "save", path: path.value, replace: replace.checked }));

  let rows = {};
  const showGains = () => {
    const wanted = Object.keys(model.get("gains")).slice(0, MOST_SLIDERS);
    if (wanted.join("\n") !== Object.keys(rows).join("\n")) {
      gains.replaceChildren();
      rows = {};
      if (!wanted.length) made(gains, "div", { class: "dobc-hint" }, "No agent is pinned.");
      for (const label of wanted) rows[label] = slider(gains, `gain of ${label}`, "1/s", [0.01, 1000],
        () => current("gains")[label] ?? 1, (v) => move("gains", { ...current("gains"), [label]: v }));
    }
    Object.values(rows).forEach((refresh) => refresh());
    network();
  };
  const showNumbers = () => {
    const found = model.get("numbers"), radius = model.get("radius");
    const top = found.lambda_max === null ? "is left out: h may have a kink" : `${digits(found.lambda_max)} 1/s`;
    const held = found.lambda_max !== null && found.lambda_max < 0;
    numbers.replaceChildren();
    made(numbers, "div", {}, `λmax(Λ) ${found.lambda_max === null ? "" : "about "}${top}${found.lambda_max === null ? "" : held ? ", negative: Lemma 1 may hold" : ", not negative: Lemma 1 fails"}`);
    made(numbers, "div", {}, found.reach > 0
      ? `At this rate the box |e| ≤ ${digits(found.reach, 3)} seems to shrink${found.reach >= radius ? ": all you ask for" : `; you ask for ${digits(radius, 3)}`}.`
      : "No box is found that shrinks at this rate.");
    if (found.note) made(numbers, "div", {}, found.note);
    made(numbers, "div", { class: "dobc-hint" }, `estimates, ${found.milliseconds} ms`);
    response(found, radius);
  };
  const showVerdict = () => {
    clearTimeout(lost);
    const said = model.get("verdict");
    verdict.className = `dobc-verdict dobc-${said.verdict ?? "moving"}`;
    verdict.textContent = said.busy ? "Deciding exactly …"
      : said.verdict ? `${said.verdict.toUpperCase()}${said.rate ? `, rate ${said.rate} 1/s` : ""}. ${said.text}`
      : "The exact verdict comes when you rest.";
  };
  const answered = () => { pending = false; clearTimeout(lost); showNumbers(); if (waiting) flush(); else rested(); };
  model.on("change:numbers", answered);
  model.on("change:gains", showGains);
  model.on("change:radius change:rate", () => fixed.forEach((refresh) => refresh()));
  model.on("change:verdict", showVerdict);
  model.on("msg:custom", (message) => { if (message.kind === "saved") saved.textContent = message.text; });
  fixed.forEach((refresh) => refresh());
  showGains();
  showNumbers();
  showVerdict();
  if (!model.get("verdict").verdict) rested();
  return () => { clearTimeout(rest); clearTimeout(lost); };
}

export default { render };
