"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const get = (id) => document.getElementById(id);
const config = { displaylogo: false, responsive: true, modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };
const depths = [...new Set(data.rows.map((row) => row.depth))];
const same = (a, b) => a[0] === b[0] && a[1] === b[1];
const state = { aperture: 0, geometry: 0, depth: depths[0], near: 0 };
let drawn = "";
const curves = () => data.curves[state.aperture][state.geometry];

function short(value, unit = "") {
  if (value === null || value === undefined) return "–";
  if (value === 0) return "0" + unit;
  const size = Math.abs(value);
  const text = size >= 1e-3 && size < 1e5 ? String(Number(value.toPrecision(3))) : value.toExponential(2);
  return text + unit;
}

function candidates() {
  return data.rows
    .filter((row) => same(row.aperture, data.apertures[state.aperture]) && row.geometry === state.geometry && row.depth === state.depth)
    .sort((a, b) => a.near - b.near);
}

function closest(rows) {
  const gap = (row) => Math.abs(Math.log(row.near / state.near));
  return rows.reduce((best, row, i) => (gap(row) < gap(rows[best]) ? i : best), 0);
}

function drawPlots() {
  for (const [name, figure] of Object.entries(curves())) {
    const place = get("plot-" + name);
    place.hidden = figure === null;
    if (figure === null) continue;
    Plotly.react(place, figure.data, figure.layout, config);
    place.removeAllListeners("plotly_click");
    place.on("plotly_click", (event) => {
      const index = event.points[0].customdata;
      if (index !== undefined) choose(data.rows[index]);
    });
  }
  drawn = `${state.aperture} ${state.geometry}`;
}

function choose(row) {
  state.aperture = data.apertures.findIndex((index) => same(index, row.aperture));
  state.geometry = row.geometry;
  state.depth = row.depth;
  state.near = row.near;
  show();
}

// Tables are made of elements and text nodes only: text from a scene is never read as markup.
function cell(text, { head = false, number = false, span = 1 } = {}) {
  const made = document.createElement(head ? "th" : "td");
  made.textContent = text;
  if (number) made.className = "n";
  if (span > 1) made.colSpan = span;
  return made;
}

function line(cells, name = "") {
  const made = document.createElement("tr");
  made.className = name;
  made.append(...cells);
  return made;
}

function fill(table, titles, lines) {
  const head = document.createElement("thead"), body = document.createElement("tbody");
  head.append(line([cell("", { head: true }), ...titles.map((title) => cell(title, { head: true, number: true }))]));
  body.append(...lines);
  table.replaceChildren(head, body);
}

const figure = (text) => cell(text, { number: true });

function numbers(row) {
  const c = row.comparison, d = c.displacement_px, p = row.predicted_displacement_px;
  const share = (part) => (part === null ? "–" : `${part.wrong.toLocaleString()} (${short(100 * part.fraction)} %)`);
  const spread = (label, s) => line([cell(label), ...["rms", "p50", "p95", "p99", "max"].map((key) => figure(short(s && s[key])))]);
  const wide = (label, text) => line([cell(label), cell(text, { span: 5 })]);
  const parts = (stage) => Object.entries(row.parts_s[stage] || {}).map(([part, s]) => ` (of which ${part} ${short(1000 * s)})`).join("");
  const time = Object.entries(row.times_s).map(([stage, s]) => `${stage} ${short(1000 * s)} ms${parts(stage)}`).join(", ");
  fill(get("numbers"), ["rms", "median", "95 %", "99 %", "max"], [
    spread("displacement measured, px", d),
    ...(row.predicted_surface ? [spread("displacement predicted, px", p)] : []),
    line([cell(`height error, ${data.units}`), figure(short(c.height && c.height.rms)), cell("", { span: 3 }), figure(short(c.height && c.height.max))]),
    wide("wrong surface", `${share(c.surface)} of ${c.judged.toLocaleString()} judged pixels`),
    wide("another triangle", share(c.triangle)),
    wide("truth shows a surface at", `${c.covered.toLocaleString()} pixels; ${c.at_plate.toLocaleString()} drawn in the plate itself`),
    ...light(c.radiance, wide),
    wide("wall time", time),
  ]);
}

function predictions(row) {
  const c = row.comparison, p = row.predicted_surface, d = c.displacement_px, q = row.predicted_displacement_px;
  if (p === null) return;
  const beside = (label, predicted, measured, ratio, name) => line([cell(label), figure(predicted), figure(measured), figure(ratio)], name);
  const ratio = (value) => (value === null ? "–" : value.toPrecision(3));
  const moved = (label, key) => beside(`displacement ${label}`, short(q && q[key], " px"), short(d && d[key], " px"), ratio(row.measured_over_predicted["displacement_" + key]));
  const count = (share) => { const n = share * c.judged; return n < 1000 ? Number(n.toPrecision(2)).toString() : Math.round(n).toLocaleString(); };
  const part = (label, share) => beside(label, count(share), "", "", "part");
  const apart = (value) => {
    if (value === null) return "nothing visible";
    return value < data.reach ? `${short(value)} ${data.units}` : "none within the reach";
  };
  const why = Object.entries(row.prediction_reasons).filter(([, reason]) => reason !== null);
  fill(get("predictions"), ["predicted", "measured", "measured / predicted"], [
    moved("rms", "rms"),
    moved("99 %", "p99"),
    beside("pixels with the wrong surface", count(p.fraction), c.surface.wrong.toLocaleString(), ratio(row.measured_over_predicted.surface)),
    part("along silhouettes, displaced", p.silhouettes),
    part("from outside the film", p.outside),
    part("edges snapped to subpixels", p.snapped),
    part("depth out of order, or lost", p.depth),
    ...(p.culled ? [part("faces culled", p.culled)] : []),
    beside("smallest separation in order, farthest surface of C", apart(row.smallest_separation.c), "", ""),
    beside("smallest separation in order, farthest surface of C*", apart(row.smallest_separation.c_star), "", ""),
    ...why.map(([name, reason]) => beside(`${name}: ${reason}`, "", "", "", "part")),
  ]);
}

function legend(row) {
  if (get("causes") === null) return;
  const parts = row.causes.filter((cause) => cause.surface > 0).map(({ name, surface }) => {
    const swatch = document.createElement("i"), text = document.createElement("em");
    swatch.style.background = data.cause_colors[name];
    text.textContent = `${name} ${surface.toLocaleString()}`;
    return [swatch, text];
  });
  get("causes").replaceChildren(...(parts.length ? parts.flat() : ["no pixel is wrong"]));
  const share = row.comparison.surface;
  document.querySelector('[data-layer="causes"]').classList.toggle("sparse", share !== null && share.fraction < 0.002);
}

function show() {
  const rows = candidates();
  const place = closest(rows);
  const row = rows[place];
  state.near = row.near;
  get("aperture").value = state.aperture;
  get("geometry").value = state.geometry;
  get("near").max = rows.length - 1;
  get("near").value = place;
  get("near-value").textContent = `${short(row.near)} ${data.units} = ${short(row.near / data.reach)} of the reach`;
  for (const button of get("depths").children) button.setAttribute("aria-pressed", button.textContent === state.depth);
  const shown = { ...row.pictures, truth: data.truths[state.aperture] };
  for (const image of document.querySelectorAll("[data-layer]")) image.src = data.pictures[shown[image.dataset.layer]];
  for (const part of document.querySelectorAll("[data-number]")) {
    const count = row.comparison[part.dataset.number];
    for (const mask of document.querySelectorAll(`[data-layer="${part.dataset.number}"]`)) {
      mask.classList.toggle("sparse", count !== null && count.fraction < 0.002);
    }
    part.textContent = count === null ? "not known" : `${count.wrong.toLocaleString()} px, ${short(100 * count.fraction)} %`;
  }
  numbers(row);
  predictions(row);
  legend(row);
  if (drawn !== `${state.aperture} ${state.geometry}`) drawPlots();
  const upright = { type: "line", xref: "x", yref: "paper", x0: row.near / data.reach, x1: row.near / data.reach, y0: 0, y1: 1, line: { color: "#80868f", width: 1.2, dash: "dot" } };
  for (const [name, figure] of Object.entries(curves())) if (figure !== null) Plotly.relayout(get("plot-" + name), { shapes: [upright] });
}

for (const depth of depths) {
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = depth;
  button.addEventListener("click", () => { state.depth = depth; show(); });
  get("depths").append(button);
}
get("aperture").addEventListener("change", (event) => { state.aperture = Number(event.target.value); show(); });
get("geometry").addEventListener("change", (event) => { state.geometry = Number(event.target.value); show(); });
get("near").addEventListener("input", (event) => { state.near = candidates()[event.target.value].near; show(); });

zoomed(get("panels"));

for (const name of Object.keys(data.curves[0][0])) Plotly.newPlot(get("plot-" + name), [], {}, config);
data.scout.forEach((map, place) => Plotly.newPlot(get("plot-scout").children[place], map.data, map.layout, { ...config, displayModeBar: false }));
choose(data.rows[data.start]);
