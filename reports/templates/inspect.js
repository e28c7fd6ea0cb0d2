const page = JSON.parse(document.getElementById("data").textContent);
const get = (id) => document.getElementById(id);
const canvas = get("canvas"), stage = get("stage"), pen = canvas.getContext("2d");
const MODES = { wipe: "wipe", truth: "truth", image: "image", difference: "difference" };
const NOTHING = [44, 48, 54], RED = [224, 49, 49], MAX_ZOOM = 160, GRID_ZOOM = 10, TEXT_ZOOM = 64, WIPE_REACH = 9, KEPT_HOGELS = 2;
const VIRIDIS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
const HEAT = [[20, 11, 52], [120, 28, 109], [207, 68, 70], [251, 155, 6], [252, 255, 164]];
const STATES = { "right": null, "not judged": [150, 90, 200], "tie, not judged": [150, 90, 200], "wrong": RED, "wrong surface": RED, "wrong surface, whose point belongs outside the film": [214, 51, 132], "right surface, another triangle": [245, 135, 0] };
// Okabe and Ito's palette, which all tell apart, in the order of the labels.
const CLASSES = [null, [0, 114, 178], [230, 159, 0], [0, 158, 115], [204, 121, 167], [213, 94, 0], [86, 180, 233], [240, 228, 66]];
const VIEWS = [
  ["color", "color", ["R", "G", "B"]], ["state", "right or wrong", ["state"]], ["state.corrected", "right or wrong, corrected", ["state.corrected"]],
  ["cause", "cause", ["cause"]], ["rounding", "rounding", ["rounding"]], ["displacement", "displacement", ["displacement.X", "displacement.Y"]],
  ["id.triangle", "triangle", ["id.triangle"]], ["id.object", "object", ["id.object"]], ["P.Z", "height, P.Z", ["P.Z"]], ["P.X", "P.X", ["P.X"]],
  ["P.Y", "P.Y", ["P.Y"]], ["N", "normal", ["N.X", "N.Y", "N.Z"]], ["certainty", "certainty", ["certainty"]],
];
const state = { hogel: 0, channel: "", mode: "wipe", wipe: 0.5, scale: 1, x: 0, y: 0, fitted: true, at: null, held: false };
const hogels = new Map(), files = new Map();
let shown = null, noted = 0, pending = false;

// --- Hogels: their channels, from this page or from a file beside it.

function takeStream(key, text) {
  files.get(key).resolve(text);
}

function fromFile(key, file) {
  if (!files.has(key)) {
    const entry = {};
    entry.text = new Promise((resolve, reject) => {
      entry.resolve = resolve;
      const script = document.createElement("script");
      script.nonce = page.nonce;
      script.src = file;
      script.onload = () => reject(new Error(`${file} belongs to another page: write both again.`));
      script.onerror = () => {
        files.delete(key);
        reject(new Error(`${file} is not there: it must lie in the folder of this page.`));
      };
      document.head.append(script);
    });
    files.set(key, entry);
  }
  return files.get(key).text;
}

async function loaded(number) {
  if (hogels.has(number)) return hogels.get(number);
  const one = page.hogels[number], [width, height] = one.size;
  if (!one.key) throw new Error("This hogel has too many pixels for a page; xfrustum trace and raster write it as OpenEXR files.");
  if (!window.DecompressionStream) throw new Error("This browser is too old to inflate the channels: it lacks DecompressionStream.");
  const here = get("stream-" + one.key);
  const text = here ? JSON.parse(here.textContent) : await fromFile(one.key, one.file);
  const channels = await unpacked(text, one.layers, width * height);
  const heads = {};
  for (const layer of one.layers) for (const channel of layer.channels) heads[layer.name + "/" + channel.name] = channel;
  const found = { number, width, height, channels, heads, pictures: new Map(), words: Object.fromEntries(one.layers.map((layer) => [layer.name, layer.words])) };
  files.delete(one.key);
  hogels.set(number, found);
  for (const key of hogels.keys()) if (hogels.size > KEPT_HOGELS && key !== number) hogels.delete(key);
  return found;
}

// Left and right of the wipe; one name where there is nothing to wipe.
function sides() {
  const there = layersOf(viewOf(state.channel));
  if (!compared()) return [there[0]];
  return state.mode === "wipe" ? ["truth", "image"] : [state.mode];
}

// --- The picture.

function dots() {
  return window.devicePixelRatio || 1;
}

function sized() {
  const box = stage.getBoundingClientRect();
  canvas.width = Math.max(1, Math.round(box.width * dots()));
  canvas.height = Math.max(1, Math.round(box.height * dots()));
}

function fit() {
  state.scale = Math.min(canvas.width / shown.width, canvas.height / shown.height);
  state.x = (canvas.width - state.scale * shown.width) / 2;
  state.y = (canvas.height - state.scale * shown.height) / 2;
  state.fitted = true;
}

function zoom(factor, x = canvas.width / 2, y = canvas.height / 2) {
  const smallest = Math.min(canvas.width / shown.width, canvas.height / shown.height);
  const scale = Math.min(Math.max(state.scale * factor, smallest), Math.max(MAX_ZOOM * dots(), smallest));
  if (scale === smallest) fit();
  else {
    state.x = x - (x - state.x) * scale / state.scale;
    state.y = y - (y - state.y) * scale / state.scale;
    state.scale = scale;
    state.fitted = false;
    bounded();
  }
  draw();
  note();
}

// Half of the picture at least stays in view.
function bounded() {
  for (const [axis, size, room] of [["x", shown.width, canvas.width], ["y", shown.height, canvas.height]]) {
    state[axis] = Math.min(Math.max(state[axis], room / 2 - state.scale * size), room / 2);
  }
}

function draw() {
  if (pending || !shown) return;
  pending = true;
  requestAnimationFrame(() => {
    pending = false;
    drawNow();
  });
}

function drawNow() {
  if (!shown) return;
  const both = sides(), pictures = both.map(picture), { scale, x, y } = state;
  const cut = both.length > 1 ? Math.round(state.wipe * canvas.width) : canvas.width;
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.imageSmoothingEnabled = scale < 1;
  pictures.forEach(({ copy }, side) => {
    pen.save();
    pen.beginPath();
    pen.rect(side ? cut : 0, 0, side ? canvas.width - cut : cut, canvas.height);
    pen.clip();
    pen.drawImage(copy, x, y, scale * shown.width, scale * shown.height);
    if (scale >= TEXT_ZOOM * dots()) texts(both[side]);
    pen.restore();
  });
  if (scale >= GRID_ZOOM * dots()) grid();
  if (state.at) {
    const [column, row] = state.at, wide = Math.max(1, dots());
    pen.lineWidth = wide;
    pen.strokeStyle = "#000";
    pen.strokeRect(x + column * scale - wide, y + row * scale - wide, scale + 2 * wide, scale + 2 * wide);
    pen.strokeStyle = state.held ? "#ffd43b" : "#fff";
    pen.strokeRect(x + column * scale, y + row * scale, scale, scale);
  }
  if (both.length > 1) {
    pen.fillStyle = "#ffd43b";
    pen.fillRect(cut - dots(), 0, 2 * dots(), canvas.height);
    pen.fillRect(cut - 4 * dots(), canvas.height - 60 * dots(), 8 * dots(), 36 * dots());
  }
  get("tag-left").textContent = both[0] === "difference" ? "|image - truth|" : words(both[0]);
  get("tag-right").textContent = both.length > 1 ? words(both[1]) : "";
  get("zoom").textContent = state.fitted ? "fit" : `${short(Number((scale / dots()).toPrecision(2)))}x`;
  explain(pictures[0].legend);
}

function words(layer) {
  return layer === "error" ? viewOf(state.channel)[1] : shown.words[layer];
}

function visible() {
  const { scale, x, y } = state, least = (from) => Math.max(0, Math.floor(-from / scale));
  return [least(x), least(y), Math.min(shown.width, Math.ceil((canvas.width - x) / scale)), Math.min(shown.height, Math.ceil((canvas.height - y) / scale))];
}

function grid() {
  const [left, top, right, bottom] = visible(), { scale, x, y } = state;
  pen.strokeStyle = "rgba(128, 128, 128, 0.45)";
  pen.lineWidth = 1;
  pen.beginPath();
  for (let column = left; column <= right; column++) {
    pen.moveTo(Math.round(x + column * scale) + 0.5, y + top * scale);
    pen.lineTo(Math.round(x + column * scale) + 0.5, y + bottom * scale);
  }
  for (let row = top; row <= bottom; row++) {
    pen.moveTo(x + left * scale, Math.round(y + row * scale) + 0.5);
    pen.lineTo(x + right * scale, Math.round(y + row * scale) + 0.5);
  }
  pen.stroke();
}

// Values within the pixels, when these are large enough.
function texts(side) {
  const [left, top, right, bottom] = visible(), { scale, x, y } = state, names = viewOf(state.channel)[2];
  pen.font = `${Math.round(11 * dots())}px ui-monospace, monospace`;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 3 * dots();
  pen.strokeStyle = "rgba(0, 0, 0, 0.75)";
  pen.fillStyle = "#fff";
  for (let row = top; row < bottom; row++) for (let column = left; column < right; column++) {
    const i = row * shown.width + column;
    names.forEach((name, line) => {
      const value = side === "difference" ? shown.channels.image[name][i] - shown.channels.truth[name][i] : shown.channels[side][name][i];
      const head = side === "difference" ? null : shown.heads[side + "/" + name];
      const label = head?.labels[value], text = label ? label.split(/[ ,]/)[0] : Number.isNaN(value) ? "-" : Number.isInteger(value) ? String(value) : short(value);
      const place = [x + (column + 0.5) * scale, y + (row + 0.5) * scale + (line - (names.length - 1) / 2) * 13 * dots()];
      pen.strokeText(text, ...place);
      pen.fillText(text, ...place);
    });
  }
}

function element(tag, text, kind) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

const css = (color) => `rgb(${color.map(Math.round).join(",")})`;

function explain(legend) {
  const text = JSON.stringify(legend);
  if (get("legend").dataset.of === text) return;
  get("legend").dataset.of = text;
  get("legend").replaceChildren(...legend.map(([kind, first, colors, last]) => {
    const made = element("span");
    if (kind === "chip") {
      const chip = element("i");
      chip.style.background = css(colors);
      made.append(chip, first);
    } else if (kind === "scale") {
      const bar = element("u");
      bar.style.background = `linear-gradient(to right, ${colors.map(css).join(",")})`;
      made.append(first, bar, last);
    } else made.append(first);
    return made;
  }));
}

// --- The values of a pixel.

function objectOf(number) {
  return page.objects[number - 1]?.name.split("/").pop() ?? "";
}

function meaning(layer, name, value) {
  const label = shown.heads[layer + "/" + name].labels[value];
  if (label !== undefined) return label;
  if (name === "id.object") return value ? objectOf(value) : "nothing";
  return name === "id.triangle" && !value ? "nothing" : "";
}

function cell(layer, name, i) {
  const head = shown.heads[layer + "/" + name], made = element("td");
  made.dataset.layer = layer;
  made.dataset.channel = name;
  if (!head) return made;
  const value = shown.channels[layer][name][i];
  made.append(exact(value, head.kind));
  const told = meaning(layer, name, value);
  if (told) made.append(" ", element("small", told));
  return made;
}

function apart(name, i) {
  const one = shown.channels.truth?.[name]?.[i], other = shown.channels.image?.[name]?.[i];
  if (one === undefined || other === undefined) return [element("td"), false];
  if (Number.isNaN(one) && Number.isNaN(other)) return [element("td"), false];
  const same = one === other;
  const text = same ? "0" : shown.heads["truth/" + name].kind === "float32" ? short(other - one) : "another";
  return [element("td", text === "NaN" ? "-" : text), !same];
}

function tell() {
  const table = get("values");
  if (!shown || !state.at) return;
  const [column, row] = state.at, i = row * shown.width + column;
  get("where").textContent = `pixel ${column}, ${row}`;
  get("pinned").textContent = state.held ? "held: click to let go" : "";
  const heads = page.hogels[shown.number].layers, names = new Set(heads.filter((layer) => layer.name !== "error").flatMap((layer) => layer.channels.map((one) => one.name)));
  const top = element("tr"), rows = [top];
  for (const text of ["channel", "truth", "image", "image - truth"]) top.append(element("th", text));
  const current = viewOf(state.channel)[2], line = (name) => {
    const made = element("tr"), first = element("td", name);
    if (current.includes(name)) made.className = "chosen";
    first.dataset.view = VIEWS.find((view) => view[2].includes(name))?.[0] ?? "";
    made.append(first);
    rows.push(made);
    return made;
  };
  for (const name of names) {
    const made = line(name), [moved, differs] = apart(name, i), pair = ["truth", "image"].map((layer) => cell(layer, name, i));
    if (differs) pair[1].className = "differs";
    if (shown.heads["image/" + name]) made.append(...pair, moved);
    else {
      pair[0].colSpan = 3;
      made.append(pair[0]);
    }
  }
  for (const { name } of heads.find((layer) => layer.name === "error")?.channels ?? []) {
    const made = cell("error", name, i);
    made.colSpan = 3;
    line(name).append(made);
  }
  table.replaceChildren(...rows);
}

// --- The plate.

function cellSize() {
  return Math.max(1, Math.floor(240 / Math.max(page.cells.length, page.cells[0].length)));
}

function plate() {
  const map = get("map"), size = cellSize(), rows = page.cells.length, columns = page.cells[0].length, brush = map.getContext("2d");
  map.width = columns * size;
  map.height = rows * size;
  const values = page.cells.flat().filter((value) => value > 0), high = Math.max(0, ...values), low = Math.min(high, ...values);
  // Where one hogel is far worse than others, only a logarithm shows these.
  const logarithmic = high > 100 * low, level = (value) => (logarithmic ? Math.log(value / low) / Math.log(high / low) : value / high);
  brush.fillStyle = css([205, 209, 214]);
  brush.fillRect(0, 0, map.width, map.height);
  page.cells.forEach((line, row) => line.forEach((value, column) => {
    if (value === null) return;
    brush.fillStyle = css(levels(VIRIDIS, value > 0 ? level(value) : 0));
    brush.fillRect(column * size, row * size, size, size);
  }));
  page.hogels.forEach(({ aperture }, number) => {
    const place = placeOf(aperture), wide = Math.max(size, 9), chosen = number === state.hogel;
    const [x, y] = place.map((one, axis) => Math.min(Math.max((one + 0.5) * size - wide / 2, 3), (axis ? map.height : map.width) - wide - 3));
    brush.lineWidth = 4;
    brush.strokeStyle = "#fff";
    brush.strokeRect(x, y, wide, wide);
    brush.lineWidth = 2;
    brush.strokeStyle = chosen ? "#e03131" : "#000";
    brush.strokeRect(x, y, wide, wide);
  });
  const told = (value) => (page.in_percent ? `${short(100 * value)} %` : short(value));
  const scale = logarithmic ? `yellow is ${told(high)}, dark ${told(low)} or less, on a logarithmic scale` : high ? `yellow is ${told(high)}, dark 0` : "0 everywhere";
  get("map-words").textContent = `${page.plate[0]} x ${page.plate[1]} hogels as the viewer faces them. ${page.map_words}: ${scale}; gray: not known. Squares: hogels to look at.`;
}

function placeOf([column, row]) {
  const rows = page.cells.length, columns = page.cells[0].length;
  return [Math.floor(column * columns / page.plate[0]), Math.floor(row * rows / page.plate[1])];
}

get("map").addEventListener("click", (event) => {
  const box = get("map").getBoundingClientRect();
  const at = [(event.clientX - box.left) / box.width * page.cells[0].length - 0.5, (event.clientY - box.top) / box.height * page.cells.length - 0.5];
  const far = page.hogels.map(({ aperture }) => Math.hypot(...placeOf(aperture).map((one, axis) => one - at[axis])));
  look(far.indexOf(Math.min(...far)));
});

page.hogels.forEach((one, number) => {
  const button = element("button", `hogel ${one.aperture.join(",")}`);
  button.type = "button";
  button.setAttribute("role", "option");
  button.append(element("br"), element("small", one.words + (one.file ? `; in ${one.file}` : "")));
  button.addEventListener("click", () => look(number));
  get("hogels").append(button);
});

// --- What is chosen.

async function look(number) {
  state.hogel = number;
  [...get("hogels").children].forEach((button, i) => button.setAttribute("aria-selected", i === number));
  plate();
  wait("reading hogel " + page.hogels[number].aperture.join(",") + " ..");
  let found;
  try {
    found = await loaded(number);
  } catch (error) {
    if (number === state.hogel) wait(error.message);
    return;
  }
  if (number !== state.hogel) return;
  const resized = !shown || shown.width !== found.width || shown.height !== found.height;
  shown = found;
  wait("");
  views();
  if (resized || state.fitted) fit();
  if (state.at) state.at = inside(state.at);
  choose(state.channel);
  document.body.dataset.shown = page.hogels[number].aperture.join(",");
}

function wait(text) {
  get("wait").textContent = text;
  get("wait").hidden = !text;
}

function views() {
  const there = VIEWS.filter((view) => layersOf(view).length);
  get("channel").replaceChildren(...there.map(([name, text]) => new Option(text, name)));
  if (!there.some(([name]) => name === state.channel)) state.channel = usual();
}

// The channel that shows most of what truth and image have in common.
function usual() {
  const both = ["color", "P.Z", "id.triangle", "id.object"].filter((name) => compared(name));
  return both[0] ?? get("channel").options[0].value;
}

function choose(channel) {
  state.channel = channel;
  get("channel").value = channel;
  for (const button of get("modes").children) {
    button.disabled = !compared();
    button.setAttribute("aria-pressed", compared() && button.dataset.mode === state.mode);
  }
  draw();
  tell();
  note();
}

function next(step) {
  const names = [...get("channel").options].map((one) => one.value);
  choose(names[(names.indexOf(state.channel) + step + names.length) % names.length]);
}

function mode(name) {
  state.mode = name;
  if (!compared()) state.channel = usual();
  choose(state.channel);
}

for (const name of Object.keys(MODES)) {
  const button = element("button", name);
  button.type = "button";
  button.dataset.mode = name;
  button.title = `${name} (${name[0]})`;
  button.addEventListener("click", () => mode(name));
  get("modes").append(button);
}

function inside([column, row]) {
  return [Math.min(Math.max(column, 0), shown.width - 1), Math.min(Math.max(row, 0), shown.height - 1)];
}

function point(at) {
  state.at = at;
  draw();
  tell();
}

// The nearest view that has a pixel within.
function reveal([column, row]) {
  const margin = 24 * dots();
  for (const [axis, place, room] of [["x", column, canvas.width], ["y", row, canvas.height]]) {
    const low = state[axis] + place * state.scale;
    if (low < margin || low + state.scale > room - margin) state[axis] = room / 2 - (place + 0.5) * state.scale;
  }
  if (!state.fitted) bounded();
}

function step(columns, rows) {
  const from = state.at || [Math.floor(shown.width / 2) - columns, Math.floor(shown.height / 2) - rows];
  const at = inside([from[0] + columns, from[1] + rows]);
  if (!state.fitted) reveal(at);
  point(at);
  note();
}

function wrong(way) {
  const channel = shown.channels.error?.state;
  if (!channel) return;
  const labels = shown.heads["error/state"].labels, count = channel.length;
  const surfaces = labels.map((label) => label.startsWith("wrong"));
  const bad = channel.some((value) => surfaces[value]) ? surfaces : labels.map((label) => label.includes("another"));
  let i = state.at ? state.at[1] * shown.width + state.at[0] : way > 0 ? -1 : 0;
  for (let steps = 0; steps < count; steps++) {
    i = (i + way + count) % count;
    if (!bad[channel[i]]) continue;
    const at = [i % shown.width, Math.floor(i / shown.width)];
    if (state.scale < 16 * dots()) {
      state.scale = 16 * dots();
      state.fitted = false;
      state.x = canvas.width / 2 - (at[0] + 0.5) * state.scale;
      state.y = canvas.height / 2 - (at[1] + 0.5) * state.scale;
    }
    reveal(at);
    state.held = true;
    point(at);
    note();
    return;
  }
  get("meaning").textContent = "No pixel of this hogel is wrong.";
}

// --- Mouse, fingers and keys.

const pointers = new Map();
let dragged = null, pinched = 0, travelled = 0;

function place(event) {
  const box = canvas.getBoundingClientRect();
  return [(event.clientX - box.left) * canvas.width / box.width, (event.clientY - box.top) * canvas.height / box.height];
}

function pixelAt([x, y]) {
  const at = [Math.floor((x - state.x) / state.scale), Math.floor((y - state.y) / state.scale)];
  return at[0] >= 0 && at[1] >= 0 && at[0] < shown.width && at[1] < shown.height ? at : null;
}

function onWipe([x]) {
  return compared() && state.mode === "wipe" && Math.abs(x - state.wipe * canvas.width) < WIPE_REACH * dots();
}

canvas.addEventListener("pointerdown", (event) => {
  if (!shown) return;
  canvas.setPointerCapture(event.pointerId);
  const at = place(event);
  pointers.set(event.pointerId, at);
  dragged = pointers.size === 1 && onWipe(at) ? "wipe" : "image";
  if (pointers.size === 1) travelled = 0;
  pinched = 0;
});

canvas.addEventListener("pointermove", (event) => {
  if (!shown) return;
  const at = place(event), before = pointers.get(event.pointerId);
  if (before) {
    pointers.set(event.pointerId, at);
    travelled += Math.hypot(at[0] - before[0], at[1] - before[1]);
    if (pointers.size === 2) pinch();
    else if (dragged === "wipe") state.wipe = Math.min(Math.max(at[0] / canvas.width, 0), 1);
    else if (travelled > 4 * dots()) {
      state.x += at[0] - before[0];
      state.y += at[1] - before[1];
      state.fitted = false;
      bounded();
    }
  }
  canvas.style.cursor = dragged === "wipe" || (!before && onWipe(at)) ? "ew-resize" : "";
  const pixel = pixelAt(at);
  if (pixel && !state.held && !(before && travelled > 4 * dots())) point(pixel);
  else draw();
});

function pinch() {
  const [one, other] = [...pointers.values()], length = Math.hypot(one[0] - other[0], one[1] - other[1]);
  if (pinched) zoom(length / pinched, (one[0] + other[0]) / 2, (one[1] + other[1]) / 2);
  pinched = length;
}

function lifted(event) {
  const at = pointers.get(event.pointerId);
  pointers.delete(event.pointerId);
  if (!shown || !at || event.type === "pointercancel") return;
  if (travelled <= 4 * dots() && dragged !== "wipe") {
    const pixel = pixelAt(at);
    if (event.pointerType === "mouse" && state.held) state.held = false;
    else if (pixel) state.held = event.pointerType === "mouse";
    if (pixel) point(pixel);
  }
  dragged = null;
  note();
}
canvas.addEventListener("pointerup", lifted);
canvas.addEventListener("pointercancel", lifted);
canvas.addEventListener("wheel", (event) => {
  if (!shown) return;
  event.preventDefault();
  zoom(2 ** (-event.deltaY / 240), ...place(event));
}, { passive: false });

async function copyValues() {
  const text = [...get("values").rows].map((row) => [...row.cells].map((one) => one.textContent).join("\t")).join("\n");
  try {
    await navigator.clipboard.writeText(`${get("where").textContent}\n${text}`);
    get("meaning").textContent = "Copied.";
  } catch {
    get("meaning").textContent = "The browser does not let this page copy: select the values.";
  }
}

const KEYS = {
  w: () => mode("wipe"), t: () => mode("truth"), i: () => mode("image"), d: () => mode("difference"), c: () => next(1), C: () => next(-1),
  n: () => wrong(1), N: () => wrong(-1), "+": () => zoom(2), "=": () => zoom(2), "-": () => zoom(0.5), 0: () => { fit(); draw(); note(); },
  "[": () => turn(-1), "]": () => turn(1), ",": () => slide(-0.02), ".": () => slide(0.02), "?": help, y: copyValues,
  " ": () => { state.held = !state.held && state.at !== null; point(state.at); note(); },
};
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

function turn(way) {
  look((state.hogel + way + page.hogels.length) % page.hogels.length);
}

function slide(share) {
  state.wipe = Math.min(Math.max(state.wipe + share, 0), 1);
  draw();
}

function help() {
  get("help").showModal();
}

document.addEventListener("keydown", (event) => {
  const writes = event.target.closest("select, button") && [" ", "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight"].includes(event.key);
  if (!shown || event.ctrlKey || event.metaKey || event.altKey || get("help").open || writes) return;
  const arrow = ARROWS[event.key], action = KEYS[event.key];
  if (!arrow && !action) return;
  event.preventDefault();
  get("meaning").textContent = "";
  if (arrow) step(...arrow.map((one) => one * (event.shiftKey ? 10 : 1)));
  else action();
});

get("channel").addEventListener("change", () => choose(get("channel").value));
get("values").addEventListener("click", (event) => {
  const view = event.target.dataset?.view;
  if (view && layersOf(viewOf(view)).length) choose(view);
});
get("smaller").addEventListener("click", () => zoom(0.5));
get("larger").addEventListener("click", () => zoom(2));
get("fit").addEventListener("click", () => KEYS[0]());
get("next").addEventListener("click", () => wrong(1));
get("help-button").addEventListener("click", help);
new ResizeObserver(() => {
  sized();
  if (shown && state.fitted) fit();
  drawNow();
}).observe(stage);

// --- The address: where one has looked at, for others.

function note() {
  clearTimeout(noted);
  noted = setTimeout(() => {
    const { hogel, channel, mode: shownAs, at, scale, fitted } = state;
    const parts = { hogel: page.hogels[hogel].aperture.join(","), channel, mode: shownAs, ...(at && { pixel: at.join(",") }), ...(!fitted && { zoom: short(scale / dots()) }) };
    try {
      history.replaceState(null, "", "#" + Object.entries(parts).map(([key, value]) => `${key}=${value}`).join("&"));
    } catch {
      // A page within another one may have no address of its own.
    }
  }, 400);
}

async function start() {
  const asked = Object.fromEntries(location.hash.slice(1).split("&").map((part) => part.split("=")));
  const number = page.hogels.findIndex((one) => one.aperture.join(",") === asked.hogel);
  if (asked.mode in MODES) state.mode = asked.mode;
  if (asked.channel && viewOf(asked.channel)) state.channel = asked.channel;
  sized();
  await look(Math.max(number, 0));
  const pixel = (asked.pixel || "").split(",").map(Number);
  if (!shown || pixel.length !== 2 || !pixel.every(Number.isInteger)) return;
  const at = inside(pixel), scale = Number(asked.zoom) * dots();
  if (scale > 0) {
    state.fitted = false;
    state.scale = Math.min(scale, MAX_ZOOM * dots());
    state.x = canvas.width / 2 - (at[0] + 0.5) * state.scale;
    state.y = canvas.height / 2 - (at[1] + 0.5) * state.scale;
  }
  state.held = true;
  point(at);
}
start();
