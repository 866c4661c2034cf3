// Wires the page: sorting, the viewer's controls, keyboard and pointer.
'use strict';

lacuna.sort = function (table, column, ascending) {
  const body = table.tBodies[0];
  const key = (row) => {
    const cell = row.cells[column];
    const value = cell && cell.dataset.value;
    return value === undefined || value === '' ? NaN : value === 'inf' ? Infinity : Number(value);
  };
  const rows = [...body.rows].map((row, index) => ({ row, index, key: key(row) }));
  rows.sort((a, b) => {
    if (Number.isNaN(a.key) || Number.isNaN(b.key)) return Number.isNaN(a.key) - Number.isNaN(b.key) || a.index - b.index;
    return a.key === b.key ? a.index - b.index : (a.key < b.key) === ascending ? -1 : 1;
  });
  body.append(...rows.map((entry) => entry.row));
};

lacuna.sortable = function (table) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    if (!head.dataset.sort) return;
    const button = document.createElement('button');
    button.type = 'button';
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener('click', () => {
      const ascending = head.getAttribute('aria-sort') !== 'ascending';
      heads.forEach((other) => other.removeAttribute('aria-sort'));
      head.setAttribute('aria-sort', ascending ? 'ascending' : 'descending');
      lacuna.sort(table, column, ascending);
    });
  });
};

lacuna.CONTROLS = `
  <h2 id="shown"></h2>
  <div class="bar" role="toolbar" aria-label="Viewer">
    <label>Frame <select id="frame"></select></label>
    <label>Left <select id="left"></select></label>
    <label>Right <select id="right"></select></label>
    <label>Exposure <input id="exposure" type="range" min="-10" max="10" step="0.25" value="0"><output id="stops">0</output></label>
    <label>Curve <select id="curve"><option value="srgb">sRGB</option><option value="linear">linear</option><option value="false">false colour</option></select></label>
    <label>Error x <select id="gain"><option>1</option><option selected>10</option><option>100</option></select></label>
    <button type="button" id="play" aria-pressed="false">Play</button>
    <button type="button" id="grid" aria-pressed="false">Side by side</button>
    <button type="button" id="out" aria-label="Zoom out">-</button>
    <button type="button" id="in" aria-label="Zoom in">+</button>
    <button type="button" id="fit">Fit</button>
    <button type="button" id="single">1 : 1</button>
  </div>
  <canvas tabindex="0" role="img" aria-label="Left and right image; keys are listed below"></canvas>
  <input id="split" type="range" min="0" max="1" step="0.001" value="0.5" aria-label="Slider between the left and the right image">
  <p id="readout" role="status">&nbsp;</p>
  <details class="keys"><summary>Keys and pointer</summary><p>Drag the slider or use <kbd>&larr;</kbd> <kbd>&rarr;</kbd>; drag the image to
  move it, turn the wheel or pinch to zoom, up to single pixels with their values. With the image in focus: <kbd>+</kbd> <kbd>-</kbd> zoom,
  <kbd>W</kbd> <kbd>A</kbd> <kbd>S</kbd> <kbd>D</kbd> move, <kbd>0</kbd> fit, <kbd>[</kbd> <kbd>]</kbd> exposure, <kbd>L</kbd> curve,
  <kbd>F</kbd> false colour (stops about mid grey), <kbd>1</kbd> to <kbd>8</kbd> right image, with <kbd>Shift</kbd> left image, <kbd>G</kbd> side by
  side, <kbd>N</kbd> <kbd>P</kbd> next and previous frame, space plays the frames.</p></details>`;

lacuna.start = function () {
  const table = document.getElementById('frames');
  if (table) lacuna.sortable(table);
  const root = document.getElementById('viewer');
  const sources = [...document.querySelectorAll('script.pixels')];
  if (!root || sources.length === 0) return;
  if (typeof DecompressionStream === 'undefined') {
    root.textContent = 'This browser is too old for the viewer (no DecompressionStream); the tables and pictures below are complete.';
    root.hidden = false;
    return;
  }
  root.innerHTML = lacuna.CONTROLS;
  root.hidden = false;
  document.body.classList.add('script');
  const $ = (id) => document.getElementById(id);
  const viewer = new lacuna.Viewer(root, () => {
    const { left, right, grid } = viewer.seen();
    $('split').value = viewer.state.split;
    $('split').disabled = grid;
    $('left').value = left;
    $('right').value = right;
    $('exposure').value = viewer.state.exposure;
    $('stops').value = `${viewer.state.exposure >= 0 ? '+' : ''}${viewer.state.exposure}`;
    $('curve').value = viewer.state.curve;
    $('grid').setAttribute('aria-pressed', grid);
    // For what only an image of errors has.
    $('gain').parentElement.hidden = !viewer.shown().some((view) => view === 'error' || view === 'estimate');
  });
  lacuna.viewer = viewer;

  const cache = new Map();
  let kept = 2;
  lacuna.open = async function (index) {
    const source = sources.find((source) => source.dataset.index === String(index));
    if (!source) return;
    if (!cache.has(index)) cache.set(index, lacuna.unpack(JSON.parse(source.textContent)));
    // A large frame is tens of megabytes once it is unpacked: two at a time. A shot of small ones stays, so that it plays.
    while (cache.size > kept) cache.delete(cache.keys().next().value);
    viewer.index = index;
    const frame = await cache.get(index);
    if (viewer.index !== index) return;
    kept = Math.max(2, Math.floor(6e6 / (frame.width * frame.height)));
    $('frame').value = index;
    $('shown').textContent = source.dataset.label.replace(/^f/, 'F');
    viewer.show(frame);
    for (const id of ['left', 'right', 'grid', 'split']) {
      const control = $(id).closest('label') || $(id);
      control.hidden = viewer.views().length < 2;
    }
    for (const id of ['left', 'right']) {
      $(id).replaceChildren(...viewer.views().map((view) => new Option(lacuna.NAMES[view], view)));
      $(id).value = viewer.seen()[id];
    }
    document.body.dataset.ready = index;
  };
  const step = (by) => {
    const at = sources.findIndex((source) => source.dataset.index === String(viewer.index));
    return lacuna.open(sources[(at + by + sources.length) % sources.length].dataset.index);
  };
  let turn = 0;
  const play = async () => {
    viewer.playing = !viewer.playing;
    const own = ++turn;
    $('play').setAttribute('aria-pressed', viewer.playing);
    $('play').textContent = viewer.playing ? 'Stop' : 'Play';
    // Another loop may have begun while this one waited.
    while (viewer.playing && own === turn) {
      await Promise.all([step(1), new Promise((resolve) => setTimeout(resolve, 1000 / 12))]);
    }
  };
  $('play').hidden = sources.length < 2;
  $('play').addEventListener('click', play);
  $('frame').replaceChildren(...sources.map((source) => new Option(source.dataset.label.replace(/^frame /, ''), source.dataset.index)));
  $('frame').addEventListener('change', (event) => lacuna.open(event.target.value));
  for (const id of ['left', 'right']) $(id).addEventListener('change', (event) => viewer.set({ [id]: event.target.value, grid: false }));
  $('split').addEventListener('input', (event) => viewer.set({ split: Number(event.target.value) }));
  $('exposure').addEventListener('input', (event) => viewer.adjust({ exposure: Number(event.target.value) }));
  $('curve').addEventListener('change', (event) => viewer.adjust({ curve: event.target.value }));
  $('gain').addEventListener('change', (event) => viewer.adjust({ gain: Number(event.target.value) }));
  $('grid').addEventListener('click', () => viewer.set({ grid: !viewer.state.grid }));
  const centre = () => { const box = viewer.canvas.getBoundingClientRect(); return [box.width / 2, box.height / 2]; };
  const fit = () => { viewer.fit(); viewer.draw(); };
  $('in').addEventListener('click', () => viewer.zoomBy(2, ...centre()));
  $('out').addEventListener('click', () => viewer.zoomBy(0.5, ...centre()));
  $('fit').addEventListener('click', fit);
  $('single').addEventListener('click', () => viewer.set({ zoom: 1 }));
  document.querySelectorAll('button.show').forEach((button) => button.addEventListener('click', () => {
    lacuna.open(button.dataset.index);
    root.scrollIntoView({ behavior: 'smooth' });
  }));
  lacuna.pointer(viewer, $('readout'));
  lacuna.keys(viewer, step, fit, centre, play);
  lacuna.open(sources[0].dataset.index);
};

lacuna.pointer = function (viewer, readout) {
  const { canvas } = viewer;
  const place = (event) => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
  const held = new Map();
  let slides = false;
  const tell = (x, y) => {
    const at = viewer.frame && viewer.pixel(x, y);
    if (!at || !at.inside) return;
    const [column, row] = [Math.floor(at.column), Math.floor(at.row)];
    const list = (view) => viewer.values(view, column, row).join(' ');
    const measured = viewer.frame.mask ? (viewer.frame.measured(row * viewer.frame.width + column) ? ', measured' : ', missing') : '';
    const told = ['reference', 'result', 'error', 'estimate'].filter((view) => viewer.views().includes(view));
    const words = { estimate: 'estimated error' };
    const values = told.map((view) => `${words[view] || view} ${list(view)}`).join(' | ');
    readout.textContent = `Pixel (${column + viewer.frame.origin[0]}, ${row + viewer.frame.origin[1]})${measured}: ${values}`;
  };
  canvas.addEventListener('pointerdown', (event) => {
    const [x, y] = place(event);
    held.set(event.pointerId, [x, y]);
    canvas.setPointerCapture(event.pointerId);
    slides = held.size === 1 && !viewer.seen().grid && Math.abs(x - viewer.state.split * canvas.getBoundingClientRect().width) < 14;
  });
  canvas.addEventListener('pointermove', (event) => {
    const [x, y] = place(event);
    tell(x, y);
    const before = held.get(event.pointerId);
    if (!before) return;
    const ratio = canvas.width / canvas.getBoundingClientRect().width;
    const others = [...held].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    if (others.length > 0) {
      const [a, b] = [before, [x, y]].map((at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]));
      viewer.zoomBy(b / Math.max(a, 1), (x + others[0][0]) / 2, (y + others[0][1]) / 2);
    } else if (slides) {
      viewer.set({ split: Math.min(1, Math.max(0, x / canvas.getBoundingClientRect().width)) });
    } else {
      const at = viewer.pixel(x, y);
      if (at) viewer.pan((before[0] - x) * ratio / at.scale / viewer.frame.aspect, (before[1] - y) * ratio / at.scale);
    }
    held.set(event.pointerId, [x, y]);
  });
  for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, (event) => held.delete(event.pointerId));
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    viewer.zoomBy(2 ** (-event.deltaY / 240), ...place(event));
    tell(...place(event));
  }, { passive: false });
};

lacuna.keys = function (viewer, step, fit, centre, play) {
  viewer.canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !viewer.frame) return;
    const { state } = viewer;
    const far = 40 / viewer.scale(viewer.cells()[0]);
    const slide = (by) => viewer.set({ split: Math.min(1, Math.max(0, state.split + by)) });
    const digit = /^Digit([1-8])$/.exec(event.code);
    const view = digit && viewer.views()[Number(digit[1]) - 1];
    const actions = {
      ArrowLeft: () => slide(-0.02), ArrowRight: () => slide(0.02),
      '+': () => viewer.zoomBy(2, ...centre()), '=': () => viewer.zoomBy(2, ...centre()), '-': () => viewer.zoomBy(0.5, ...centre()),
      w: () => viewer.pan(0, -far), s: () => viewer.pan(0, far), a: () => viewer.pan(-far, 0), d: () => viewer.pan(far, 0),
      0: fit, '[': () => viewer.adjust({ exposure: Math.max(-10, state.exposure - 0.5) }),
      ']': () => viewer.adjust({ exposure: Math.min(10, state.exposure + 0.5) }),
      l: () => viewer.adjust({ curve: state.curve === 'srgb' ? 'linear' : 'srgb' }),
      f: () => viewer.adjust({ curve: state.curve === 'false' ? 'srgb' : 'false' }), ' ': play,
      g: () => viewer.set({ grid: !state.grid }), n: () => step(1), p: () => step(-1),
    };
    const action = view ? () => viewer.set({ [event.shiftKey ? 'left' : 'right']: view, grid: false }) : actions[event.key] || actions[event.key.toLowerCase()];
    if (!action) return;
    event.preventDefault();
    action();
  });
};

lacuna.start();
