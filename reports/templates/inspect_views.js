// --- Views: what a channel looks like.

function layersOf(view) {
  return ["truth", "image", "error"].filter((layer) => view[2].every((name) => shown.channels[layer]?.[name]));
}

function viewOf(name) {
  return VIEWS.find((view) => view[0] === name);
}

function compared(name = state.channel) {
  const there = layersOf(viewOf(name));
  return there.includes("truth") && there.includes("image");
}

function covers(layer) {
  const { "id.triangle": triangle, "id.object": object, "P.Z": height } = shown.channels[layer];
  return (i) => triangle?.[i] > 0 || object?.[i] > 0 || (height ? !Number.isNaN(height[i]) : false);
}

function levels(colors, share) {
  const place = Math.min(Math.max(share, 0), 1) * (colors.length - 1), low = Math.min(Math.floor(place), colors.length - 2);
  return colors[low].map((from, axis) => from + (place - low) * (colors[low + 1][axis] - from));
}

function encoded(linear) {
  const c = Math.min(Math.max(linear, 0), 1);
  return 255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055);
}

function ends(arrays) {
  let low = Infinity, high = -Infinity;
  for (const array of arrays) for (const value of array) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low <= high ? [low, high] : null;
}

// A color for each number; neighboring numbers get colors far apart.
function ofNumber(number) {
  return [37, 101, 173].map((factor, axis) => ((number * factor + [90, 60, 140][axis]) % 200) + 30);
}

function dim(i, covered) {
  const { R, G, B } = shown.channels.truth;
  if (!covered(i)) return NOTHING;
  const gray = R ? 150 + 0.35 * encoded((R[i] + G[i] + B[i]) / 3) : 205;
  return [gray, gray, gray];
}

function labelColor(name, label, number) {
  return name.startsWith("state") ? STATES[label] : CLASSES[number % CLASSES.length];
}

// The color of each pixel of one layer of a view, and its legend.
function painter(view, layer) {
  const [name, , names] = view, own = names.map((one) => shown.channels[layer][one]), head = shown.heads[layer + "/" + names[0]];
  const covered = covers(layer === "error" ? "truth" : layer);
  if (name === "color") return { color: (i) => (covered(i) || own[0][i] > 0 ? own.map((one) => encoded(one[i])) : NOTHING), legend: [["text", "linear radiance, in sRGB"]] };
  if (name === "N") return { color: (i) => (covered(i) ? own.map((one) => 127.5 * (one[i] + 1)) : NOTHING), legend: [["text", "red N.X, green N.Y, blue N.Z, each from -1 to 1"]] };
  if (head.labels.length) {
    const colors = head.labels.map((label, number) => labelColor(name, label, number)), counts = head.labels.map(() => 0);
    for (const value of own[0]) counts[value]++;
    return {
      color: (i) => colors[own[0][i]] || dim(i, covered),
      legend: head.labels.map((label, number) => ["chip", `${label}: ${counts[number].toLocaleString("en")}`, colors[number] || [205, 205, 205]]).filter((chip, number) => counts[number]),
    };
  }
  if (name === "displacement") {
    const length = (i) => Math.hypot(own[0][i], own[1][i]);
    return scaled(length, own[0].length, (i) => dim(i, covered), HEAT, "px");
  }
  if (head.kind === "uint32") return { color: (i) => (own[0][i] ? ofNumber(own[0][i] - 1) : NOTHING), legend: [["text", "each number has a color"]] };
  const range = ends(["truth", "image"].map((one) => shown.channels[one]?.[name]).filter(Boolean)) || [0, 0];
  return {
    color: (i) => (Number.isNaN(own[0][i]) ? NOTHING : levels(VIRIDIS, (own[0][i] - range[0]) / (range[1] - range[0] || 1))),
    legend: [["scale", `${short(range[0])} ${page.units}`, VIRIDIS, `${short(range[1])} ${page.units}`]],
  };
}

// Sizes on a logarithmic scale of four decades below the largest; what is zero or unknown has another color.
function scaled(size, count, otherwise, colors, unit, alone) {
  let high = 0;
  for (let i = 0; i < count; i++) {
    const one = size(i);
    if (one > high && one < Infinity) high = one;
  }
  const legend = high ? [["scale", `${short(high / 1e4)} ${unit} or less`, colors, `${short(high)} ${unit}`]] : [["text", "zero everywhere"]];
  return {
    color: (i) => {
      if (alone?.(i)) return RED;
      const one = size(i);
      return one > 0 ? levels(colors, 1 + Math.log10(one / high) / 4) : otherwise(i);
    },
    legend: alone ? [...legend, ["chip", "shown by one of the two", RED]] : legend,
  };
}

function difference(view) {
  const [name, , names] = view, { truth, image } = shown.channels, there = covers("truth"), here = covers("image");
  const gray = (i) => dim(i, there), pairs = names.map((one) => [truth[one], image[one]]);
  if (shown.heads["truth/" + names[0]].kind !== "float32") {
    const [one, other] = pairs[0];
    return { color: (i) => (one[i] === other[i] ? gray(i) : RED), legend: [["chip", "another number", RED], ["chip", "the same", [205, 205, 205]]] };
  }
  const size = (i) => Math.max(...pairs.map(([one, other]) => Math.abs(other[i] - one[i])));
  const unit = name.startsWith("P.") ? page.units : "";
  return scaled((i) => size(i) || 0, pairs[0][0].length, gray, HEAT, unit, name === "color" ? null : (i) => there(i) !== here(i));
}

function picture(which) {
  const view = viewOf(state.channel), key = state.channel + "/" + which;
  if (!shown.pictures.has(key)) {
    const { color, legend } = which === "difference" ? difference(view) : painter(view, which);
    const copy = document.createElement("canvas"), { width, height } = shown;
    copy.width = width;
    copy.height = height;
    const data = new ImageData(width, height);
    for (let i = 0; i < width * height; i++) {
      const [r, g, b] = color(i);
      data.data[4 * i] = r;
      data.data[4 * i + 1] = g;
      data.data[4 * i + 2] = b;
      data.data[4 * i + 3] = 255;
    }
    copy.getContext("2d").putImageData(data, 0, 0);
    shown.pictures.set(key, { copy, legend });
  }
  return shown.pictures.get(key);
}
