"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const get = (id) => document.getElementById(id);
const letters = { true: "A", replayed: "B", drawn: "C" };
const shown = Object.keys(letters).filter((name) => data.eyes[0].pictures[name]);
const [width, height] = data.size;
const canvas = get("canvas"), stage = get("stage");
const state = { eye: 0, left: shown[0], right: shown[shown.length - 1], wipe: 0.5, at: null };
const cache = new Map();
let timer = null;

// Pictures are small; on the canvas each pixel becomes a square of whole pixels.
const zoom = Math.max(1, Math.round(1200 / width));
canvas.width = width * zoom;
canvas.height = height * zoom;
// Cells of the plate need not be square: the picture has the shape of the plate.
canvas.style.aspectRatio = String(data.aspect);

function loaded(address) {
  if (!cache.has(address)) {
    cache.set(address, new Promise((resolve) => {
      const image = new Image();
      image.onload = () => resolve(image);
      image.src = address;
    }));
  }
  return cache.get(address);
}

function pixels(image) {
  const copy = document.createElement("canvas");
  copy.width = width;
  copy.height = height;
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, width, height).data;
}

const stored = new Map();
async function values(eye, name) {
  const key = eye + name;
  if (!stored.has(key)) {
    const pictures = data.eyes[eye].pictures[name];
    const parts = await Promise.all([pictures.numbers, pictures.heights].map(loaded));
    stored.set(key, parts.map(pixels));
  }
  return stored.get(key);
}

function short(value) {
  if (value === null || value === undefined) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e-3 && size < 1e5 ? String(Number(value.toPrecision(3))) : value.toExponential(2);
}

function element(tag, text, kind) {
  const made = document.createElement(tag);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

function row(cells, tag = "td") {
  const made = document.createElement("tr");
  cells.forEach((text, i) => made.append(element(tag, text, i > 1 ? "n" : "")));
  return made;
}

async function draw() {
  const { eye, left, right } = state;
  const pictures = data.eyes[eye].pictures;
  const both = await Promise.all([loaded(pictures[left].color), loaded(pictures[right].color)]);
  if (eye !== state.eye || left !== state.left || right !== state.right) return;
  const context = canvas.getContext("2d");
  context.imageSmoothingEnabled = false;
  const cut = Math.round(state.wipe * width);
  context.drawImage(both[1], 0, 0, width, height, 0, 0, canvas.width, canvas.height);
  if (cut > 0) context.drawImage(both[0], 0, 0, cut, height, 0, 0, cut * zoom, canvas.height);
  context.fillStyle = "#ffd43b";
  context.fillRect(cut * zoom - 1, 0, 2, canvas.height);
  get("left").textContent = `${letters[left]}: ${data.names[left]}`;
  get("right").textContent = `${letters[right]}: ${data.names[right]}`;
  const which = data.eyes.length > 1 ? `eye ${eye + 1} of ${data.eyes.length}, at ` : "eye at ";
  get("place").textContent = `${which}${data.eyes[eye].record.eye.map(short).join(", ")} ${data.units}`;
  tell();
}

function objectOf(triangle) {
  let found = data.objects[0];
  for (const object of data.objects) if (object.first <= triangle) found = object;
  return found.name;
}

async function tell() {
  const place = get("values");
  if (!state.at) {
    place.replaceChildren(element("p", "Point at the picture to read what each view shows there.", "fine"));
    return;
  }
  const { eye, at } = state, [column, line] = at, index = 4 * (line * width + column);
  const table = document.createElement("table");
  table.append(row([`pixel ${column}, ${line}`, "object", "triangle", `height z (${data.units})`], "th"));
  for (const name of shown) {
    const [numbers, heights] = await values(eye, name);
    const triangle = 65536 * numbers[index] + 256 * numbers[index + 1] + numbers[index + 2] - 1;
    const step = 256 * heights[index] + heights[index + 1], ends = data.heights;
    const z = step === ends.steps ? null : ends.low + (ends.high - ends.low) * step / (ends.steps - 1);
    const nothing = triangle < 0, renderer = data.eyes[eye].record.renderer;
    // Colors alone do not say whether a surface is there.
    const none = name === "drawn" && renderer && renderer.wrong === null ? "unknown" : "nothing";
    table.append(row([`${letters[name]}: ${data.names[name]}`, nothing ? none : objectOf(triangle),
      nothing ? "–" : String(triangle), z === null ? "–" : z.toFixed(3)]));
  }
  // Pictures take time to load: meanwhile the pointer, or the eye, may have moved on.
  if (eye === state.eye && at === state.at) place.replaceChildren(table);
}

function losses() {
  const found = data.eyes[state.eye].losses;
  const words = { display: "The display's loss, on B: A against B", renderer: "The renderer's loss, on C: B against C" };
  get("losses").replaceChildren(...Object.keys(found).map((name) => {
    const figure = document.createElement("figure"), image = document.createElement("img");
    image.src = found[name];
    image.alt = words[name];
    figure.append(image, element("figcaption", words[name]));
    return figure;
  }));
}

function numbers() {
  const table = get("numbers");
  const head = ["eye", "lost by", "wrong surfaces", "of judged", "displaced p50 (')", "p99 (')", "max (')", `depth p99 (${data.units})`, "FLIP"];
  const rows = [row(head, "th")];
  data.eyes.forEach(({ record }, i) => {
    for (const name of ["display", "renderer"]) {
      const loss = record[name];
      if (!loss) continue;
      const moved = loss.displacement_arcmin || {}, depth = loss.depth_error || {};
      const made = row([`${i + 1}: ${record.eye.map(short).join(", ")}`, name, loss.wrong === null ? "unknown" : String(loss.wrong),
        loss.fraction === null ? "–" : `${short(100 * loss.fraction)} %`, short(moved.p50), short(moved.p99), short(moved.max), short(depth.p99), short(loss.flip)]);
      if (i === state.eye) made.className = "chosen";
      rows.push(made);
    }
  });
  table.replaceChildren(...rows);
}

function look(eye) {
  state.eye = eye;
  get("eye").value = eye;
  losses();
  numbers();
  draw();
}

function pick(left, right) {
  Object.assign(state, { left, right });
  for (const button of get("pairs").children) button.setAttribute("aria-pressed", button.dataset.pair === left + right);
  draw();
}

const pairs = shown.length === 3 ? [["true", "replayed"], ["replayed", "drawn"], ["true", "drawn"]] : [["true", "replayed"]];
for (const [left, right] of pairs) {
  const button = element("button", `${letters[left]} | ${letters[right]}`);
  button.type = "button";
  button.dataset.pair = left + right;
  button.addEventListener("click", () => pick(left, right));
  get("pairs").append(button);
}

function follow(event) {
  const box = canvas.getBoundingClientRect();
  const share = (value, size) => Math.min(Math.max(value / size, 0), 1 - 1e-9);
  const x = share(event.clientX - box.left, box.width), y = share(event.clientY - box.top, box.height);
  state.at = [Math.floor(x * width), Math.floor(y * height)];
  if (event.buttons & 1) {
    state.wipe = x;
    draw();
  } else {
    tell();
  }
}
stage.addEventListener("pointermove", follow);
stage.addEventListener("pointerdown", (event) => {
  stage.setPointerCapture(event.pointerId);
  follow(event);
});
canvas.addEventListener("keydown", (event) => {
  const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[event.key];
  if (!step) return;
  event.preventDefault();
  state.wipe = Math.min(Math.max(state.wipe + step, 0), 1);
  draw();
});
get("eye").addEventListener("input", () => look(Number(get("eye").value)));
get("play").addEventListener("click", () => {
  const play = timer === null;
  get("play").setAttribute("aria-pressed", play);
  get("play").textContent = play ? "stop" : "play";
  if (!play) {
    clearInterval(timer);
    timer = null;
    return;
  }
  let step = 1;
  timer = setInterval(() => {
    if (state.eye + step < 0 || state.eye + step >= data.eyes.length) step = -step;
    look(state.eye + step);
  }, 350);
});

look(Math.floor(data.eyes.length / 2));
pick(...pairs[pairs.length === 3 ? 1 : 0]);
