// The drawing, the sliders and the fields. Every result comes from the kernel; nothing is loaded from anywhere.
const SVG = "http://www.w3.org/2000/svg";
const SIZE = 380, MARGIN = 34, REST = 700; // px, px, ms without a change until the exact verdict is asked for
const MOST_SLIDERS = 40, PATIENCE = 15000; // ms without an answer from the kernel until the page says so
const LOST = "The kernel does not answer. After a restart run this cell again; changes that were not saved as a problem file are lost.";
const KEYS = ["gains", "arcs", "radius", "rate"]; // what Undo brings back

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
  return Math.abs(value) < 1e-12 ? "0" : String(Number(Number(value).toPrecision(count)));
}

function ticks(top) { // 0 and some round numbers up to top
  const power = 10 ** Math.floor(Math.log10(top / 4));
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => top / each <= 5);
  return Array.from({ length: Math.floor(top / step * (1 + 1e-9)) + 1 }, (_, k) => k * step);
}

function drawNetwork(holder, model, { pin, join, mode }) {
  const { labels, places, agrees, multiples } = model.get("network");
  const svg = made(holder, "svg:svg", { viewBox: `0 0 ${SIZE} ${SIZE}`, role: "group", "aria-label": "Network" });
  const id = `tip${Math.random().toString(36).slice(2)}`;
  const marker = made(made(svg, "svg:defs"), "svg:marker", { id, viewBox: "0 0 8 8", refX: 8, refY: 4,
    markerWidth: 7, markerHeight: 7, orient: "auto" });
  made(marker, "svg:path", { d: "M0 1 L8 4 L0 7 z", class: "dobc-tip" });
  const arcs = made(svg, "svg:g");
  const size = labels.length > 60 ? 7 : labels.length > 25 ? 11 : 15;
  const INSIDE = 3, LONGEST = 48; // letters that fit into a circle, and into the drawing
  const at = (k) => places[k].map((c, axis) => SIZE / 2 + (axis ? -1 : 1) * c * (SIZE / 2 - MARGIN));
  const fits = labels.every((label) => label.length <= INSIDE); // all inside their circles, or none
  const bends = {}; // of arcs, by their ends
  const bentTo = (a, b) => { // the middle of an arc, or a point aside where agents are in its way
    const [x1, y1] = at(a), [x2, y2] = at(b), clear = 1.5 * size;
    const others = labels.map((_, k) => k).filter((k) => k !== a && k !== b).map(at);
    let best = null, widest = -1;
    for (const bend of [0, 0.15, -0.15, 0.3, -0.3, 0.5, -0.5]) {
      const x = (x1 + x2) / 2 - bend * (y2 - y1), y = (y1 + y2) / 2 + bend * (x2 - x1);
      let least = clear;
      for (let t = 0.05; t < 1; t += 0.05) {
        const p = (1 - t) ** 2, q = 2 * t * (1 - t), r = t * t;
        for (const [u, v] of others) least = Math.min(least, Math.hypot(p * x1 + q * x + r * x2 - u, p * y1 + q * y + r * y2 - v));
      }
      if (least > widest) { best = [x, y]; widest = least; }
      if (least >= clear) break;
    }
    return best;
  };
  let from = null; // the agent on which the mouse went down
  const agents = labels.map((label, k) => {
    const [x, y] = at(k);
    const group = made(svg, "svg:g", { tabindex: k ? -1 : 0, role: "button", class: "dobc-agent", "data-agent": label });
    made(group, "svg:circle", { cx: x, cy: y, r: size });
    const text = label.length > LONGEST ? `${label.slice(0, LONGEST)}…` : label;
    const half = 3.8 * text.length; // about half its width, in px
    const beside = !fits ? { class: "dobc-beside", x: Math.max(half, Math.min(SIZE - half, x)),
      y: y + (y < SIZE / 2 ? -1 : 1) * (size + 7) } : {};
    made(group, "svg:text", { x, y, dy: "0.35em", "aria-hidden": "true", ...beside }, text);
    made(group, "svg:title", {}, label);
    group.addEventListener("click", () => pin(label));
    group.addEventListener("focus", () => agents.forEach((each) => each.setAttribute("tabindex", each === group ? 0 : -1)));
    group.addEventListener("pointerdown", (event) => { from = k; event.preventDefault(); group.focus(); });
    group.addEventListener("pointerup", () => { if (from !== null && from !== k) join(k, from); from = null; });
    group.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (step) agents[(k + step + labels.length) % labels.length].focus();
      else if (event.key === "Enter" || event.key === " ") pin(label);
      else return;
      event.preventDefault();
    });
    return group;
  });
  svg.addEventListener("pointerup", (event) => { if (!event.target.closest(".dobc-agent")) from = null; });
  return () => {
    arcs.replaceChildren();
    for (const [listener, speaker] of model.get("arcs")[mode()] ?? []) { // information runs from the speaker to the listener
      const ends = [listener, speaker].sort((a, b) => a - b); // opposite arcs lie on each other
      const [x, y] = bends[ends] ??= bentTo(...ends);
      const [[x1, y1], [x2, y2]] = [speaker, listener].map((k) => {
        const [u, v] = at(k), cut = (size + 2) / (Math.hypot(x - u, y - v) || 1);
        return [u + (x - u) * cut, v + (y - v) * cut];
      });
      made(arcs, "svg:path", { d: `M${x1} ${y1} Q${x} ${y} ${x2} ${y2}`, class: "dobc-arc", "marker-end": `url(#${id})` });
    }
    labels.forEach((label, k) => {
      const gain = model.get("gains")[label];
      agents[k].classList.toggle("dobc-pinned", gain !== undefined);
      agents[k].setAttribute("aria-pressed", gain !== undefined);
      agents[k].setAttribute("aria-label", `agent ${label}${agrees ? "" : gain === undefined ? ", not pinned" : `, gain ${digits(gain)}${multiples ? " times" : " 1/s"}`}`);
    });
  };
}

function drawResponse(holder, title) {
  const width = 380, height = 210, left = 46, right = 14, bottom = 40, upper = 20;
  const svg = made(holder, "svg:svg", { viewBox: `0 0 ${width} ${height}`, role: "img",
    "aria-label": `${title}, of every agent over time, without disturbance` });
  return ({ times, errors }, radius, pinned, bound) => {
    svg.replaceChildren();
    const end = times[times.length - 1] || 1;
    const highest = Math.max(radius, ...errors.map((row) => Math.max(...row)), 1e-12);
    const { tube, level } = bound;
    const top = 1.05 * Math.max(highest, Math.min(tube[0] ?? 0, 2 * highest)); // a high tube leaves half of the height to the run
    const x = (t) => left + (width - left - right) * t / end;
    const y = (e) => height - bottom - (height - bottom - upper) * Math.min(e, top) / top;
    made(svg, "svg:text", { x: 2, y: 11 }, title);
    for (const value of ticks(top)) {
      made(svg, "svg:line", { x1: left, y1: y(value), x2: width - right, y2: y(value), class: value ? "dobc-grid" : "dobc-axis" });
      made(svg, "svg:text", { x: left - 6, y: y(value), dy: "0.35em", "text-anchor": "end" }, digits(value, 3));
    }
    for (const value of ticks(end)) {
      made(svg, "svg:line", { x1: x(value), y1: y(0), x2: x(value), y2: y(0) + 4, class: "dobc-axis" });
      made(svg, "svg:text", { x: x(value), y: y(0) + 16, "text-anchor": "middle", class: "dobc-time" }, digits(value, 3));
    }
    made(svg, "svg:text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, "time in s");
    errors.forEach((row, k) => made(svg, "svg:polyline", { class: `dobc-curve${pinned[k] ? " dobc-pinned" : ""}`,
      points: points(row, (i) => x(times[i]), y) }));
    const seen = tube.findIndex((e) => e <= top); // above the drawing before
    if (seen >= 0) made(svg, "svg:polyline", { class: "dobc-curve dobc-bound",
      points: points(tube.slice(seen), (i) => x(times[i + seen]), y) });
    const isLow = level !== null && level <= top;
    if (isLow) made(svg, "svg:line", { x1: left, y1: y(level), x2: width - right, y2: y(level), class: "dobc-curve dobc-bound" });
    return seen >= 0 || isLow;
  };
}

function drawRates(holder, { points: seen, text, unit }) { // proved rate over the time that is varied
  const width = 380, height = 130, left = 46, right = 14, bottom = 40, upper = 20;
  const svg = made(holder, "svg:svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `Proved rate over the time, ${text}` });
  const end = Math.max(...seen.map(([time]) => time)), top = Math.max(...seen.map(([, rate]) => rate)) || 1;
  const x = (time) => left + (width - left - right) * time / end;
  const y = (rate) => height - bottom - (height - bottom - upper) * rate / top;
  made(svg, "svg:text", { x: 2, y: 11 }, "proved rate in 1/s");
  for (const value of [0, top]) made(svg, "svg:text", { x: left - 6, y: y(value), dy: "0.35em", "text-anchor": "end" }, digits(value, 3));
  for (const value of ticks(end)) made(svg, "svg:text", { x: x(value), y: y(0) + 16, "text-anchor": "middle", class: "dobc-time" }, digits(value, 3));
  made(svg, "svg:line", { x1: left, y1: y(0), x2: width - right, y2: y(0), class: "dobc-axis" });
  made(svg, "svg:text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, `time in ${unit}`);
  made(svg, "svg:polyline", { class: "dobc-curve dobc-bound", points: points(seen.map(([, rate]) => rate), (i) => x(seen[i][0]), y) });
  made(holder, "div", { class: "dobc-hint" }, text);
}

const points = (row, x, y) => row.map((e, i) => `${x(i).toFixed(1)},${y(e).toFixed(1)}`).join(" ");

function legend(parent, items) { // [class, what it means]
  const row = made(parent, "div", { class: "dobc-legend" });
  for (const [kind, text] of items) made(made(row, "span"), "span", { class: `dobc-key ${kind}`, "aria-hidden": "true" })
    .after(` ${text}`);
  return row;
}

function field(parent, text, unit, [low, high], get, set) {
  // A slider on a logarithmic scale and a number to be typed: the same value.
  const row = made(parent, "div", { class: "dobc-row dobc-field" });
  made(row, "span", {}, text);
  const slider = made(row, "input", { type: "range", min: 0, max: 1000, "aria-label": text });
  const number = made(row, "input", { type: "number", min: 0, step: "any", "aria-label": `${text}, ${unit}` });
  made(row, "span", { class: "dobc-unit" }, unit);
  const place = (value) => 1000 * Math.log(value / low) / Math.log(high / low);
  slider.addEventListener("input", () => set(Number((low * (high / low) ** (slider.value / 1000)).toPrecision(3)), slider));
  slider.addEventListener("change", () => set(get(), null));
  number.addEventListener("change", () => set(Number(number.value), null));
  return () => {
    slider.value = place(Math.min(high, Math.max(low, get())));
    slider.setAttribute("aria-valuetext", `${digits(get())} ${unit}`);
    number.value = digits(get(), 12);
  };
}

function render({ model, el }) {
  el.classList.add("dobc-designer");
  el.setAttribute("data-lm-suppress-shortcuts", "true"); // else JupyterLab takes the arrow keys
  const { labels, agrees, dynamics, multiples } = model.get("network"), past = [], future = [];
  let waiting = null, rest = null, pending = false, lost = null, gesture = null;
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
  const flush = () => { // at most one question is under way; what was changed meanwhile goes with the next one
    if (pending || !waiting) return;
    for (const [key, value] of Object.entries(waiting)) model.set(key, value);
    waiting = null;
    pending = true;
    expect();
    model.save_changes();
    refresh();
  };
  const current = (key) => (waiting && key in waiting ? waiting[key] : model.get(key));
  const state = () => Object.fromEntries(KEYS.map((key) => [key, current(key)]));
  const put = (changes) => {
    const told = Object.entries(changes).filter(([key, value]) => JSON.stringify(current(key)) !== JSON.stringify(value));
    if (!told.length) return false;
    waiting = { ...waiting, ...Object.fromEntries(told) };
    verdict.className = "dobc-verdict dobc-moving";
    verdict.textContent = "The exact verdict follows after a short pause.";
    beside.hidden = true;
    showInputs();
    clearTimeout(rest);
    flush();
    return true;
  };
  const change = (key, value, by = null) => { // one drag of a slider is one step of Undo
    const before = state();
    if (put({ [key]: value }) && (by === null || by !== gesture)) { past.push(before); future.length = 0; }
    gesture = by;
    refresh();
  };
  const step = (here, there) => { if (here.length) { there.push(state()); put(here.pop()); gesture = null; refresh(); } };
  const positive = (key, wrap) => (value, by) => {
    if (value > 0 && Number.isFinite(value)) { said.textContent = ""; change(key, wrap(value), by); }
    else { said.textContent = "Type a number above 0."; refresh(); }
  };
  const pin = (label) => {
    if (agrees) { said.textContent = "Agents that agree on a value have no pins."; return; }
    const gains = { ...current("gains") };
    if (label in gains) delete gains[label]; else gains[label] = model.get("network").gain;
    change("gains", gains);
  };
  const listens = (listener, speaker) => current("arcs")[mode()].some(([i, j]) => i === listener && j === speaker);
  const join = (listener, speaker) => { // adds the arc, or removes it where there is one
    if (listener === speaker) { said.textContent = "An agent does not listen to itself."; return; }
    const arcs = current("arcs"), own = arcs[mode()], there = listens(listener, speaker);
    change("arcs", { ...arcs, [mode()]: there ? own.filter(([i, j]) => i !== listener || j !== speaker) : [...own, [listener, speaker, "1"]] });
  };

  const left = made(el, "div", { class: "dobc-left" }), right = made(el, "div", { class: "dobc-right" });
  made(left, "div", { class: "dobc-title" }, model.get("network").name);
  const choice = (parent, names, name) => {
    const select = made(parent, "select", { "aria-label": name });
    names.forEach((text, k) => made(select, "option", { value: k }, text));
    select.addEventListener("change", () => refresh());
    return select;
  };
  const modes = Object.keys(model.get("arcs"));
  const modeRow = made(left, "div", { class: "dobc-row" }, modes.length > 1 ? "Mode " : "");
  const modeChoice = choice(modeRow, modes, "Mode shown");
  if (modes.length < 2) modeChoice.remove();
  const mode = () => modes[Number(modeChoice.value)];
  const network = drawNetwork(left, model, { pin, join, mode });
  const arrow = ["dobc-arrow", "information flows along the arrow"];
  legend(left, agrees ? [arrow] : [["dobc-dot dobc-on", "pinned: knows the target"], ["dobc-dot", "not pinned"], arrow]);
  const arcRow = made(left, "div", { class: "dobc-row" }, "Agent");
  const listener = choice(arcRow, labels, "Listening agent");
  arcRow.append("listens to");
  const speaker = choice(arcRow, labels, "Agent that is heard");
  if (labels.length > 1) speaker.value = 1;
  const arcButton = made(arcRow, "button", { class: "dobc-join" });
  arcButton.addEventListener("click", () => join(Number(listener.value), Number(speaker.value)));
  made(left, "div", { class: "dobc-hint" }, `${agrees ? "" : "Click an agent to pin it, again to unpin it. "}Drag from one agent to another to add or remove an arc. Arrow keys go from agent to agent${agrees ? "" : "; Enter pins"}.`);

  const verdict = made(right, "div", { class: "dobc-verdict", role: "status", "aria-live": "polite" });
  const beside = made(right, "div", { class: "dobc-hint dobc-plant", hidden: "" });
  const limited = model.get("network").limit; // in words; "" without one
  const inputs = made(right, "div", limited ? {} : { hidden: "" });
  const showInputs = (found) => { // whether they keep their limit; undefined before the verdict
    const words = found ? `${found.kept ? "proved" : "not proved"} to keep ${limited}. ${found.why}` : `whether they keep ${limited} follows with the verdict.`;
    inputs.className = `dobc-limit dobc-${found ? (found.kept ? "proved" : "refuted") : "moving"}`;
    inputs.textContent = `Inputs: ${words}`;
  };
  const numbers = made(right, "div", { class: "dobc-numbers" });
  const unit = model.get("network").unit; // "" without one
  const start = Math.max(model.get("radius"), 1e-3);
  const fixed = [
    field(right, "starts within", `${unit} of ${agrees ? "each other" : "the target"}`.trim(), [start / 50, start * 50], () => current("radius"), positive("radius", (v) => v)),
    field(right, "wanted rate", "1/s", [0.001, 10], () => current("rate"), positive("rate", (v) => v)),
  ];
  const gains = made(right, "div", { class: "dobc-gains" });
  const throughout = modes.length > 1 ? `, mode ${modes[0]} throughout` : "";
  const response = drawResponse(right, `${agrees ? "largest difference to another agent" : "distance from the goal"}, in ${unit || "units of x"}${throughout}`);
  if (!agrees) legend(right, [["dobc-line dobc-on", "pinned"], ["dobc-line", "not pinned"]]);
  const proved = made(right, "div");
  const tools = made(right, "div", { class: "dobc-row" });
  const button = (text, act) => { const made_ = made(tools, "button", {}, text); made_.addEventListener("click", act); return made_; };
  const undo = button("Undo", () => step(past, future)), redo = button("Redo", () => step(future, past));
  button("Copy as Python", () => model.send({ kind: "python" }));
  const saving = made(right, "div", { class: "dobc-row dobc-saving" });
  const path = made(saving, "input", { type: "text", value: `${model.get("network").name}-designed.toml`, "aria-label": "Name of the problem file" });
  const save = made(saving, "button", { class: "dobc-save" }, "Save as problem file");
  const again = made(saving, "label");
  const replace = made(again, "input", { type: "checkbox" });
  again.append(" replace");
  const said = made(right, "div", { class: "dobc-hint", role: "status" });
  const source = made(right, "textarea", { class: "dobc-source", readonly: "", hidden: "", rows: 8, "aria-label": "The problem as Python" });
  save.addEventListener("click", () => model.send({ kind: "save", path: path.value, replace: replace.checked }));
  el.addEventListener("keydown", (event) => {
    event.stopPropagation();
    const typing = event.target.closest("textarea, input[type=text], input[type=number]");
    if (typing || !(event.ctrlKey || event.metaKey) || !"zy".includes(event.key.toLowerCase())) return;
    event.preventDefault();
    if (event.key === "z") step(past, future); else step(future, past);
  });

  let rows = {};
  const refresh = () => {
    const all = Object.keys(current("gains")), wanted = all.slice(0, MOST_SLIDERS);
    if (!wanted.length || wanted.join("\n") !== Object.keys(rows).join("\n")) {
      gains.replaceChildren();
      rows = {};
      if (!wanted.length && !agrees) made(gains, "div", { class: "dobc-hint" }, "No agent is pinned.");
      for (const label of wanted) rows[label] = field(gains, `gain of ${label}`, multiples ? "times" : "1/s", [0.01, 1000],
        () => current("gains")[label] ?? 1, positive("gains", (v) => ({ ...current("gains"), [label]: v })));
      if (all.length > wanted.length) made(gains, "div", { class: "dobc-hint" }, `${wanted.length} of ${all.length} gains are shown.`);
    }
    [...Object.values(rows), ...fixed, network].forEach((each) => each());
    arcButton.textContent = listens(Number(listener.value), Number(speaker.value)) ? "Remove arc" : "Add arc";
    undo.disabled = !past.length;
    redo.disabled = !future.length;
  };
  const showNumbers = () => {
    const found = model.get("numbers"), radius = model.get("radius"), top = found.lambda_max;
    const decided = model.get("verdict"), isProved = decided.verdict === "proved", rate = model.get("rate");
    numbers.replaceChildren();
    if (multiples) made(numbers, "div", {}, `Gains are multiples: of the ${dynamics ? "coupling" : "identity"}, or of the matrix that the file gives.`);
    if (!agrees && !dynamics) made(numbers, "div", {}, top === null ? "λmax(Λ) is left out: h may have a kink at 0."
      : `λmax(Λ) is about ${digits(top).replace("-", "−")} 1/s; Lemma 1 needs it below\u00a00.`);
    if (!isProved && !agrees && !dynamics) made(numbers, "div", {}, found.reach > 0 // what is proved needs no estimate beside it
      ? `At the wanted rate, starts within ${digits(found.reach, 3)} of the target should converge${found.reach >= radius ? "" : `; asked for: ${digits(radius, 3)}`}.`
      : "At the wanted rate no region is found.");
    else if (isProved && !decided.rate) made(numbers, "div", {}, "No decay rate is proved.");
    else if (isProved && Number(decided.rate) < rate) made(numbers, "div", {}, `The proved rate is below the wanted one, ${digits(rate)} 1/s.`);
    if (found.note) made(numbers, "div", {}, found.note);
    made(numbers, "div", { class: "dobc-hint" }, `${dynamics ? "The curves are estimates without the disturbance" : `${agrees ? "The curves are estimates" : isProved ? "λmax and the curves are estimates" : "Estimates"} for the network without the observer`}, ${found.milliseconds} ms.`);
    const bound = decided.bound ?? { text: "", tube: [], level: null };
    const isDrawn = response(found, radius, labels.map((label) => label in model.get("gains")), bound);
    proved.replaceChildren();
    if (isDrawn) legend(proved, [["dobc-line dobc-bound", bound.text]]);
    else made(proved, "div", { class: "dobc-hint" }, bound.tube.length || bound.level ? `${bound.text} (above the drawing)` : bound.text);
    if (decided.rates) drawRates(proved, decided.rates);
  };
  const showVerdict = () => {
    clearTimeout(lost);
    const found = model.get("verdict");
    verdict.className = `dobc-verdict dobc-${found.verdict ?? "moving"}`;
    const text = found.text?.replace(/^Undecided: ./, (start) => start.at(-1).toUpperCase()).replaceAll("|∞", "|\u2060∞"); // no line ends there
    verdict.textContent = found.busy ? "Deciding exactly …"
      : found.verdict ? `${found.verdict.toUpperCase()}${found.rate ? `, rate ${found.rate} 1/s` : ""}${found.factor ? `, factor ${found.factor}` : ""}. ${text}`
      : "The exact verdict follows after a short pause.";
    const proved = [["Proved", found.conditions], ["Proved about the plant", found.plant]].filter(([, items]) => items?.length);
    beside.hidden = proved.length === 0;
    beside.textContent = proved.map(([about, items]) => `${about}: ${items.join("; ")}.`).join(" ");
    showInputs(found.limit);
    showNumbers();
  };
  const answered = () => { pending = false; clearTimeout(lost); showNumbers(); if (waiting) flush(); else rested(); };
  model.on("change:numbers", answered);
  model.on("change:gains change:arcs change:radius change:rate", refresh);
  model.on("change:verdict", showVerdict);
  model.on("msg:custom", ({ kind, text }) => {
    if (kind !== "python") { said.textContent = text; return; }
    source.hidden = false;
    source.value = text;
    navigator.clipboard?.writeText(text).then(() => { said.textContent = "Copied."; }, () => source.select());
  });
  refresh();
  showVerdict();
  if (!model.get("verdict").verdict) rested();
  return () => { clearTimeout(rest); clearTimeout(lost); };
}

export default { render };
