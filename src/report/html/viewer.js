// The viewer: two views of a frame with a slider between them, or all views side by side; zoom and position are shared.
'use strict';

lacuna.VIEWS = ['reference', 'sparse', 'result', 'error', 'estimate', 'cieluv', 'ssim', 'flip'];
lacuna.IMAGES = ['reference', 'sparse', 'result'];
lacuna.NAMES = {
  reference: 'Reference', sparse: 'Sparse input', result: 'Result', error: 'Absolute error', estimate: 'Estimated error',
  cieluv: 'CIELUV error', ssim: '1 - SSIM', flip: 'FLIP',
};

lacuna.heat = (() => {
  const stops = [[0, 0, 4], [81, 18, 124], [183, 55, 121], [252, 137, 97], [252, 253, 191]];
  const table = new Uint32Array(256);
  for (let i = 0; i < 256; i++) {
    const at = i / 255 * 4, below = Math.min(3, Math.floor(at)), part = at - below;
    const [r, g, b] = [0, 1, 2].map((k) => Math.round(stops[below][k] + part * (stops[below + 1][k] - stops[below][k])));
    table[i] = 0xff000000 | b << 16 | g << 8 | r;
  }
  return table;
})();

// The colour of 0 to 1.
lacuna.hue = (level) => (Number.isNaN(level) ? lacuna.NOT_FINITE : lacuna.heat[level > 0 ? (level < 1 ? Math.round(255 * level) : 255) : 0]);

lacuna.encode = (v, curve) => {
  const c = v > 0 ? (v < 1 ? v : 1) : 0;
  return curve === 'linear' ? c : c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055;
};

// What is not finite looks like this in every view.
lacuna.NOT_FINITE = 0xffffff00;

// CIELUV of linear colours over white, by the chromaticities of the file.
lacuna.luv = ({ matrix, white }, rgb) => {
  const [r, g, b] = rgb.map((v) => (v > 0 ? (v < 1 ? v : 1) : 0));
  const [x, y, z] = matrix.map((row) => row[0] * r + row[1] * g + row[2] * b);
  const whole = white[0] + 15 * white[1] + 3 * white[2];
  const l = y > (6 / 29) ** 3 ? 116 * Math.cbrt(y) - 16 : (29 / 3) ** 3 * y;
  const sum = x + 15 * y + 3 * z;
  return sum > 0 ? [l, 13 * l * (4 * (x / sum - white[0] / whole)), 13 * l * (9 * (y / sum - white[1] / whole))] : [0, 0, 0];
};

// Paints one view of a frame into an image of its size.
lacuna.paint = function (frame, view, state) {
  const { width, height, values } = frame;
  const n = width * height;
  const canvas = document.createElement('canvas');
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext('2d');
  const image = context.createImageData(width, height);
  const out = new Uint32Array(image.data.buffer);
  const scale = 2 ** state.exposure / frame.white;
  if (lacuna.IMAGES.includes(view) && state.curve === 'false') {
    // Brightness in stops about mid grey, seven either way.
    const [r, g, b] = lacuna.planes(frame, view);
    const light = (i) => 0.2126 * values[r[i] & 65535] + 0.7152 * values[g[i] & 65535] + 0.0722 * values[b[i] & 65535];
    for (let i = 0; i < n; i++) {
      out[i] = view === 'sparse' && !frame.measured(i) ? 0xff000000 : lacuna.hue((Math.log2(Math.max(light(i) * scale, 1e-9) / 0.18) + 7) / 14);
    }
  } else if (lacuna.IMAGES.includes(view)) {
    const none = frame.none;
    const shown = new Uint8Array(65536);
    for (let code = 0; code < 65536; code++) shown[code] = Math.round(255 * lacuna.encode(values[code] * scale, state.curve));
    const [r, g, b] = lacuna.planes(frame, view);
    for (let i = 0; i < n; i++) {
      out[i] = view === 'sparse' && !frame.measured(i) ? 0xff000000
        : r[i] === none || g[i] === none || b[i] === none ? lacuna.NOT_FINITE
        : 0xff000000 | shown[b[i] & 65535] << 16 | shown[g[i] & 65535] << 8 | shown[r[i] & 65535];
    }
  } else {
    const by = view === 'error' || view === 'estimate' ? state.gain * scale : view === 'cieluv' ? 1 / 20 : 1;
    for (let i = 0; i < n; i++) out[i] = lacuna.hue(lacuna.level(frame, view, i) * by);
  }
  context.putImageData(image, 0, 0);
  return canvas;
};

// What the ends of the colours of a view stand for, as texts; nothing for an image in its own colours.
lacuna.range = function (view, { curve, gain, exposure }, white = 1) {
  const short = (value) => String(Number(value.toPrecision(3)));
  if (lacuna.IMAGES.includes(view)) return curve === 'false' ? ['-7', `+7 stops about ${short(0.18 * white)}`] : null;
  if (view === 'error' || view === 'estimate') return ['0', short(white / (gain * 2 ** exposure))];
  return ['0', view === 'cieluv' ? '20' : '1'];
};

// The planes that a view of an image shows: without a reference the sparse input is the result where it was measured.
lacuna.planes = (frame, view) => (view === 'result' || !frame.reference ? frame.test : frame.reference);

// The value of an error map at a pixel; NaN where it has none.
lacuna.level = function (frame, view, at) {
  if (view === 'estimate') return frame.estimate.values[frame.estimate.plane[at] & 65535];
  if (view === 'error' || view === 'cieluv') {
    let most = 0;
    for (let k = 0; k < 3; k++) most = Math.max(most, Math.abs(frame.value(frame.reference, k, at) - frame.value(frame.test, k, at)));
    if (view === 'error' || Number.isNaN(most)) return most;
    const luv = (planes) => lacuna.luv(frame.colour, [0, 1, 2].map((k) => frame.value(planes, k, at) / frame.white));
    const [one, other] = [luv(frame.reference), luv(frame.test)];
    return Math.hypot(one[0] - other[0], one[1] - other[1], one[2] - other[2]);
  }
  const y = Math.floor(at / frame.width), x = at % frame.width;
  return frame.maps[view][Math.floor(y / frame.step) * frame.columns + Math.floor(x / frame.step)];
};

lacuna.Viewer = class {
  constructor(root, redrawn) {
    this.root = root;
    this.state = { left: 'reference', right: 'result', split: 0.5, exposure: 0, curve: 'srgb', gain: 10, grid: false, zoom: 0, x: 0, y: 0 };
    this.canvas = root.querySelector('canvas');
    this.context = this.canvas.getContext('2d');
    this.redrawn = redrawn;
    this.painted = new Map();
    this.frame = null;
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  show(frame) {
    const same = this.frame && this.frame.width === frame.width && this.frame.height === frame.height;
    this.frame = frame;
    this.painted.clear();
    if (!same) this.fit();
    this.draw();
  }

  views() {
    const { frame } = this;
    const { reference, colour, estimate } = frame;
    const has = { result: true, sparse: frame.mask, reference, error: reference, cieluv: reference && colour, estimate };
    return lacuna.VIEWS.filter((view) => (view in has ? has[view] : frame.maps[view]));
  }

  // What is shown of what is asked for: a frame may lack a view, and keeps no other one from it.
  seen() {
    const { left, right, grid } = this.state;
    const views = this.views();
    const had = (view, other) => (views.includes(view) ? view : other);
    return { left: had(left, views[0]), right: had(right, 'result'), grid: grid || views.length < 2 };
  }

  // Zoom 0: the whole frame. Pixels of the screen for a pixel of the frame otherwise.
  fit() {
    Object.assign(this.state, { zoom: 0, x: this.frame.width / 2, y: this.frame.height / 2 });
  }

  // Views on the screen.
  shown() {
    const { left, right, grid } = this.seen();
    return grid ? this.views() : [left, right];
  }

  // Columns and rows of pictures that show them largest in a box, and the height that they take there.
  layout(width, height) {
    const count = this.seen().grid ? this.views().length : 1;
    const of = (columns) => {
      const rows = Math.ceil(count / columns);
      return { columns, rows, scale: Math.min(width / columns / this.frame.width / this.frame.aspect, height / rows / this.frame.height) };
    };
    const all = Array.from({ length: count }, (_, k) => of(k + 1));
    const best = all.reduce((best, one) => (one.scale > best.scale ? one : best));
    return { ...best, height: Math.ceil(best.rows * best.scale * this.frame.height) };
  }

  // The cells of the screen, each with the view it shows.
  cells() {
    const { width, height } = this.canvas;
    const { grid, left } = this.seen();
    if (!grid) return [{ view: left, x: 0, y: 0, width, height }];
    const { columns, rows } = this.layout(width, height);
    const [w, h] = [Math.floor(width / columns), Math.floor(height / rows)];
    return this.views().map((view, i) => ({ view, x: i % columns * w, y: Math.floor(i / columns) * h, width: w, height: h }));
  }

  // The scale at which a cell holds the whole frame.
  whole(cell) {
    return Math.min(cell.width / this.frame.width / this.frame.aspect, cell.height / this.frame.height);
  }

  // Pixels of the screen for the height of one of the frame.
  scale(cell) {
    return this.state.zoom > 0 ? Math.max(this.state.zoom, 0.01) : this.whole(cell);
  }

  image(view) {
    if (!this.painted.has(view)) this.painted.set(view, lacuna.paint(this.frame, view, this.state));
    return this.painted.get(view);
  }

  // What changes the colours.
  adjust(change) {
    Object.assign(this.state, change);
    this.painted.clear();
    this.draw();
  }

  set(change) {
    Object.assign(this.state, change);
    this.draw();
  }

  draw() {
    const { clientWidth } = this.canvas;
    if (!this.frame || clientWidth === 0) return;
    // As high as the pictures are, as far as the window goes.
    const most = Math.min(900, Math.max(320, window.innerHeight - 330));
    this.canvas.style.height = `${Math.max(200, this.layout(clientWidth, most).height)}px`;
    const box = this.canvas.getBoundingClientRect();
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(box.width * ratio);
    this.canvas.height = Math.round(box.height * ratio);
    this.context.fillStyle = '#1b1b1b';
    this.context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    for (const cell of this.cells()) this.drawCell(cell);
    if (!this.seen().grid) this.drawSlider();
    this.redrawn();
  }

  drawCell(cell) {
    this.clipped(cell, () => this.drawView(cell, cell.view));
    if (this.seen().grid) {
      this.label(lacuna.NAMES[cell.view], cell.x + 8, cell.y + 20, 'left');
      this.bar(cell.view, cell.x + 8, cell.y + cell.height, cell.width - 16);
    }
  }

  drawSlider() {
    const { context, canvas, state } = this;
    const { left, right } = this.seen();
    const at = Math.round(canvas.width * state.split);
    const cell = { x: 0, y: 0, width: canvas.width, height: canvas.height };
    this.clipped({ ...cell, x: at, width: canvas.width - at }, () => this.drawView(cell, right));
    context.fillStyle = '#ffb000';
    context.fillRect(at - 1, 0, 2, canvas.height);
    if (at > 90) {
      this.label(lacuna.NAMES[left], at - 8, 20, 'right');
      this.bar(left, 8, canvas.height, at - 16);
    }
    if (at < canvas.width - 90) {
      this.label(lacuna.NAMES[right], at + 8, 20, 'left');
      this.bar(right, at + 8, canvas.height, canvas.width - at - 16);
    }
  }

  clipped(cell, draw) {
    const { context } = this;
    context.save();
    context.beginPath();
    context.rect(cell.x, cell.y, cell.width, cell.height);
    context.clip();
    draw();
    context.restore();
  }

  // What the colours of a view mean: a bar above `bottom`, at most `most` wide, with the values at its ends.
  bar(view, x, bottom, most) {
    const range = lacuna.range(view, this.state, this.frame.white);
    const width = Math.min(160, most);
    if (!range || width < 60) return;
    const { context } = this;
    for (let i = 0; i < width; i++) {
      const bits = lacuna.heat[Math.round(255 * i / (width - 1))];
      context.fillStyle = `rgb(${bits & 255}, ${bits >> 8 & 255}, ${bits >> 16 & 255})`;
      context.fillRect(x + i, bottom - 14, 1, 8);
    }
    context.strokeStyle = 'rgba(255,255,255,.7)';
    context.lineWidth = 1;
    context.strokeRect(x - 0.5, bottom - 14.5, width + 1, 9);
    this.label(range[0], x, bottom - 19, 'left');
    this.label(range[1], x + width, bottom - 19, 'right');
  }

  label(text, x, y, align) {
    const { context } = this;
    context.font = '13px system-ui, sans-serif';
    context.textAlign = align;
    context.lineWidth = 3;
    context.strokeStyle = 'rgba(0,0,0,.8)';
    context.strokeText(text, x, y);
    context.fillStyle = '#fff';
    context.fillText(text, x, y);
  }

  drawView(cell, view) {
    const { context, state, frame } = this;
    const scale = this.scale(cell);
    const across = scale * frame.aspect;
    const x = cell.x + cell.width / 2 - state.x * across;
    const y = cell.y + cell.height / 2 - state.y * scale;
    context.imageSmoothingEnabled = scale < 1;
    context.imageSmoothingQuality = 'high';
    context.fillStyle = '#1b1b1b';
    context.fillRect(cell.x, cell.y, cell.width, cell.height);
    context.drawImage(this.image(view), x, y, frame.width * across, frame.height * scale);
    if (Math.min(scale, across) >= 56) this.numbers(cell, view, x, y, scale, across);
  }

  // The values, written on the pixels.
  numbers(cell, view, x, y, scale, across) {
    const { context, frame } = this;
    const rows = [Math.max(0, Math.floor((cell.y - y) / scale)), Math.min(frame.height - 1, Math.floor((cell.y + cell.height - y) / scale))];
    const columns = [Math.max(0, Math.floor((cell.x - x) / across)), Math.min(frame.width - 1, Math.floor((cell.x + cell.width - x) / across))];
    context.font = `${Math.min(13, Math.min(scale, across) / 5)}px ui-monospace, monospace`;
    context.textAlign = 'center';
    context.lineWidth = 2.5;
    context.strokeStyle = 'rgba(0,0,0,.75)';
    context.fillStyle = '#fff';
    for (let v = rows[0]; v <= rows[1]; v++) {
      for (let u = columns[0]; u <= columns[1]; u++) {
        this.values(view, u, v).forEach((text, k, all) => {
          const at = [x + (u + 0.5) * across, y + (v + 0.5) * scale + (k - (all.length - 1) / 2) * scale / 4 + 4];
          context.strokeText(text, ...at);
          context.fillText(text, ...at);
        });
      }
    }
  }

  // The values of a view at a pixel (column, row of the frame), as texts.
  values(view, x, y) {
    const { frame } = this;
    const at = y * frame.width + x;
    if (view === 'sparse' && !frame.measured(at)) return ['missing'];
    if (lacuna.IMAGES.includes(view)) {
      const planes = lacuna.planes(frame, view);
      return [0, 1, 2].map((k) => lacuna.number(frame.value(planes, k, at), frame.factor));
    }
    const level = lacuna.level(frame, view, at);
    return [Number.isNaN(level) ? 'n/a' : level === 0 ? '0' : level.toPrecision(2)];
  }

  // The pixel (column, row of the frame) under a point of the canvas (in CSS pixels), and its cell.
  pixel(x, y) {
    const ratio = this.canvas.width / this.canvas.getBoundingClientRect().width;
    const [u, v] = [x * ratio, y * ratio];
    const cell = this.cells().find((cell) => u >= cell.x && u < cell.x + cell.width && v >= cell.y && v < cell.y + cell.height);
    if (!cell) return null;
    const scale = this.scale(cell);
    const column = (u - cell.x - cell.width / 2) / scale / this.frame.aspect + this.state.x;
    const row = (v - cell.y - cell.height / 2) / scale + this.state.y;
    const inside = column >= 0 && row >= 0 && column < this.frame.width && row < this.frame.height;
    return { column, row, inside, cell, scale };
  }

  // Zooms so that the pixel under a point stays there.
  zoomBy(factor, x, y) {
    const at = this.pixel(x, y);
    if (!at) return;
    const zoom = Math.min(128, Math.max(at.scale * factor, this.whole(at.cell)));
    const kept = at.scale / zoom;
    this.set({ zoom, x: at.column + (this.state.x - at.column) * kept, y: at.row + (this.state.y - at.row) * kept });
  }

  pan(columns, rows) {
    const clamp = (v, most) => Math.min(most, Math.max(0, v));
    this.set({ x: clamp(this.state.x + columns, this.frame.width), y: clamp(this.state.y + rows, this.frame.height) });
  }
};

// A value with as many digits as its step (relative, from the levels) bears.
lacuna.number = (value, factor) => {
  if (Number.isNaN(value)) return 'n/a';
  const size = Math.abs(value), step = (size + 1 / 64) * factor;
  const digits = Math.max(0, Math.ceil(-Math.log10(step)));
  // As many decimals as that are no longer read.
  if (digits > 6 && size > 0 && size < 1e-3) return value.toPrecision(Math.min(3, Math.max(1, Math.round(Math.log10(size / step)))));
  return value.toFixed(Math.min(6, digits));
};
