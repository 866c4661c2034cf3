// Unpacks the pixels of a frame: what codes.rs and picture.rs packed, the other way round.
'use strict';

const lacuna = {};

lacuna.inflate = async function (base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
};

// Low bytes, then high bytes; the sign is in the lowest bit.
lacuna.unfold = function (bytes) {
  const n = bytes.length / 2;
  const out = new Int16Array(n);
  for (let i = 0; i < n; i++) {
    const folded = bytes[i] | (bytes[n + i] << 8);
    out[i] = (folded >>> 1) ^ -(folded & 1);
  }
  return out;
};

// Adds to each value its prediction from left, above and above left; in place.
lacuna.unpredict = function (plane, width) {
  for (let at = 0; at < plane.length; at++) {
    const x = at % width;
    const left = x > 0 ? plane[at - 1] : 0;
    const above = at >= width ? plane[at - width] : 0;
    const corner = x > 0 && at >= width ? plane[at - width - 1] : 0;
    const low = left < above ? left : above;
    const high = left < above ? above : left;
    const guess = corner >= high ? low : corner <= low ? high : left + above - corner;
    plane[at] += guess;
  }
};

// Codes of an image as three planes, of red, green and blue.
lacuna.decode = function (bytes, width) {
  const folded = lacuna.unfold(bytes);
  const n = folded.length / 3;
  const [g, r, b] = [0, 1, 2].map((k) => folded.subarray(k * n, (k + 1) * n));
  for (const plane of [g, r, b]) lacuna.unpredict(plane, width);
  for (let i = 0; i < n; i++) {
    r[i] += g[i];
    b[i] += g[i];
  }
  return [r, g, b];
};

// The value of each code, and the logarithm from one to the next.
lacuna.table = function ({ levels, largest }) {
  const factor = Math.log1p(64 * largest) / levels;
  const values = new Float32Array(65536);
  for (let code = 0; code <= levels; code++) {
    const value = Math.expm1(code * factor) / 64;
    values[65536 - code & 65535] = -value;
    values[code] = value;
  }
  values[levels + 1] = NaN;
  return { factor, values };
};

// A map of 32 levels of square roots, each row less the row above.
lacuna.unmap = function (bytes, columns) {
  const out = new Float32Array(bytes.length);
  for (let at = 0; at < bytes.length; at++) {
    if (at >= columns) bytes[at] += bytes[at - columns];
    out[at] = (bytes[at] / 31) ** 2;
  }
  return out;
};

// Reference and test image (or one image alone) as three planes of codes each, a table from codes to values, mask and maps.
lacuna.unpack = async function (packed) {
  const { width, height, codes } = packed;
  const n = width * height;
  const names = Object.keys(packed.maps);
  const [first, second, mask, estimated, ...levels] = await Promise.all(
    [codes.first, codes.second, packed.mask, packed.estimate && packed.estimate.first, ...names.map((name) => packed.maps[name])].map((text) => (text ? lacuna.inflate(text) : null)));
  let [reference, test] = [null, lacuna.decode(first, width)];
  if (second) {
    reference = test;
    const less = lacuna.unfold(second);
    test = [0, 1, 2].map((k) => less.subarray(k * n, (k + 1) * n));
    for (let k = 0; k < 3; k++) for (let i = 0; i < n; i++) test[k][i] += reference[k][i];
  }
  const { factor, values } = lacuna.table(codes);
  const estimate = estimated && { plane: lacuna.decode(estimated, width)[0], ...lacuna.table(packed.estimate) };
  const columns = Math.ceil(width / packed.map_step);
  const maps = {};
  names.forEach((name, k) => { maps[name] = lacuna.unmap(levels[k], columns); });
  return {
    width, height, aspect: packed.aspect, origin: packed.origin, white: packed.white, reference, test, values, mask, factor, step: packed.map_step, columns, maps,
    estimate, colour: packed.colour, none: codes.levels + 1,
    value: (planes, k, at) => values[planes[k][at] & 65535],
    measured: (at) => !mask || (mask[at >> 3] >> (at & 7) & 1) === 1,
  };
};
