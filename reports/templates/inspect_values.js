"use strict";
// Streams of channels as typed arrays (little-endian, as on every machine with a browser), and numbers as text.

const KINDS = { float32: Float32Array, uint32: Uint32Array, uint8: Uint8Array };

function bytesOf(text) {
  const letters = atob(text), bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function unpacked(text, layers, count) {
  const bytes = await inflated(bytesOf(text)), found = {};
  let place = 0;
  for (const layer of layers) {
    found[layer.name] = {};
    for (const channel of layer.channels) {
      const length = count * KINDS[channel.kind].BYTES_PER_ELEMENT;
      found[layer.name][channel.name] = new KINDS[channel.kind](bytes.slice(place, place + length).buffer);
      place += length;
    }
  }
  return found;
}

// The fewest digits that give the same number again, in its own precision.
function exact(value, kind) {
  if (Number.isNaN(value)) return "NaN";
  if (Object.is(value, -0)) return "-0";
  if (kind !== "float32" || !Number.isFinite(value)) return String(value);
  for (let digits = 1; digits < 9; digits++) {
    const text = value.toPrecision(digits);
    if (Math.fround(Number(text)) === value) return String(Number(text));
  }
  return String(Number(value.toPrecision(9)));
}

function short(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e-3 && size < 1e5 ? String(Number(value.toPrecision(3))) : value.toExponential(1);
}
