// node render.mjs CASE OUT: casts a line through each pixel's center, in double precision.
import { readFileSync, writeFileSync } from "node:fs";
import { deflateSync, crc32 } from "node:zlib";

const [folder, out] = process.argv.slice(2);
const asked = JSON.parse(readFileSync(`${folder}/case.json`));
if (asked.near || !["triangle-id", "object-id"].includes(asked.asked)) {
  writeFileSync(`${out}/unsupported`, "only the true frustum, and no colors");
  process.exit(0);
}
const vertices = [], faces = [];
for (const line of readFileSync(`${folder}/scene.obj`, "utf8").split("\n")) {
  const [kind, ...words] = line.trim().split(/\s+/);
  if (kind === "v") vertices.push(words.map(Number));
  if (kind === "f") faces.push(words.map((word) => parseInt(word) - 1));
}
const objectOf = (t) => asked.objects.findLastIndex((one) => one.first_triangle <= t);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function png(width, height, rgb) {
  const raw = Buffer.alloc(height * (1 + 3 * width));
  for (let r = 0; r < height; r++) rgb.copy(raw, r * (1 + 3 * width) + 1, 3 * r * width, 3 * (r + 1) * width);
  const chunk = (name, data) => {
    const body = Buffer.concat([Buffer.from(name), data]), found = Buffer.alloc(body.length + 8);
    found.writeUInt32BE(data.length, 0); body.copy(found, 4);
    found.writeUInt32BE(crc32(body), body.length + 4);
    return found;
  };
  const head = Buffer.alloc(13);
  head.writeUInt32BE(width, 0); head.writeUInt32BE(height, 4); head[8] = 8; head[9] = 2;
  return Buffer.concat([Buffer.from([137, 80, 78, 71, 13, 10, 26, 10]),
    chunk("IHDR", head), chunk("IDAT", deflateSync(raw)), chunk("IEND", Buffer.alloc(0))]);
}

const [width, height] = asked.resolution;
for (const { hogel: [i, j], center, shear, half_extent } of asked.apertures) {
  const best = new Float64Array(width * height).fill(Infinity), shown = new Int32Array(width * height);
  faces.forEach((face, t) => {
    const [a, b, c] = face.map((v) => vertices[v].map((x, axis) => x - center[axis]));
    const [[ex, ey, ez], [fx, fy, fz], [gx, gy, gz]] = [cross(b, c), cross(c, a), cross(a, b)];
    const volume = a[0] * ex + a[1] * ey + a[2] * ez;
    for (let row = 0, at = 0; row < height; row++) {
      const y = shear[1] + (1 - (2 * row + 1) / height) * half_extent[1];
      for (let column = 0; column < width; column++, at++) {
        const x = shear[0] + ((2 * column + 1) / width - 1) * half_extent[0];
        const e = ex * x + ey * y - ez, f = fx * x + fy * y - fz, g = gx * x + gy * y - gz;
        if (e * f < 0 || f * g < 0 || g * e < 0 || e + f + g === 0) continue;
        const s = volume / (e + f + g);
        if (s < -asked.reach[0] || s > asked.reach[1] || s >= best[at]) continue;
        best[at] = s; shown[at] = t + 1;
      }
    }
  });
  const rgb = Buffer.alloc(3 * width * height);
  shown.forEach((number, at) => {
    if (number && asked.asked === "object-id") number = objectOf(number - 1) + 1;
    rgb.writeUIntBE(number, 3 * at, 3);
  });
  writeFileSync(`${out}/hogel_${i}x${j}.png`, png(width, height, rgb));
}
