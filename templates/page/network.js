// The network of a design and the occupancy of its PEs.

/** Draws an arrow whose head ends short of its target. */
function arrow(context, [x0, y0], [x1, y1], radius, width) {
  const length = Math.hypot(x1 - x0, y1 - y0) || 1;
  const [dx, dy] = [(x1 - x0) / length, (y1 - y0) / length];
  // The two directions of a connection run side by side.
  const aside = Math.min(radius * 0.35, 3);
  const from = [x0 + dx * radius - dy * aside, y0 + dy * radius + dx * aside];
  const to = [x1 - dx * (radius + 1) - dy * aside, y1 - dy * (radius + 1) + dx * aside];
  const head = Math.min(3 + 1.6 * width, 8, length / 3);
  context.lineWidth = width;
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(to[0] - dx * head * 0.8, to[1] - dy * head * 0.8);
  context.stroke();
  context.beginPath();
  context.moveTo(...to);
  context.lineTo(to[0] - dx * head - dy * head * 0.45, to[1] - dy * head + dx * head * 0.45);
  context.lineTo(to[0] - dx * head + dy * head * 0.45, to[1] - dy * head - dx * head * 0.45);
  context.fill();
}

/** What a PE is, in lines. */
function aboutPe(network, pe, period) {
  const { load, names, more, outputs, input } = network.pes[pe];
  const flow = (end, other) => network.links.filter((link) => link[end] === pe).sort((a, b) => b[2] - a[2])
    .map((link) => `PE ${link[other]} (${link[2]})`);
  const list = (title, items, most) => (items.length === 0 ? []
    : [`${title}: ${items.slice(0, most).join(', ')}${items.length > most ? ` and ${items.length - most} more` : ''}`]);
  return [
    `PE ${pe}: products in ${number(100 * load)} % of ${period} cycles`,
    `computes: ${names.join(', ')}${more > 0 ? ` and ${more} more` : ''}`,
    ...list('outputs', outputs, 8),
    ...(input ? ['reads an external input'] : []),
    ...list('words per step to', flow(0, 1), 10),
    ...list('words per step from', flow(1, 0), 10),
  ];
}

function networkSection({ network, period }) {
  const { pes, links } = network;
  const loads = pes.map((pe) => pe.load);
  const [low, high] = [Math.min(...loads), Math.max(...loads)];
  const most = Math.max(1, ...links.map((link) => link[2]));
  const dense = network.connections > 4 * pes.length;
  const box = section('Network', `${pes.length} ${pes.length === 1 ? 'PE' : 'PEs'}, ${network.connections} connections; the darker, the more products (${number(100 * low)} % to ${number(100 * high)} % of the cycles). Arrows point where words go, the wider the more (at most ${most} per step). Squares read an external input, double outlines compute an output. A click keeps a PE.${dense ? ' The connections are pale: a PE under the pointer shows its own.' : ''}`);
  const reading = element('p', { class: 'reading' }, 'Point at a PE.');
  const frame = element('div', { class: 'wide' });
  box.append(frame, reading);
  const [xs, ys] = [pes.map((pe) => pe.x), pes.map((pe) => pe.y)];
  const [left, top] = [Math.min(...xs), Math.min(...ys)];
  const [spanX, spanY] = [Math.max(...xs) - left || 1, Math.max(...ys) - top];
  let [places, radius, near, kept] = [[], 5, null, null];
  const height = (width) => Math.min(spanY * Math.min((width - 60) / spanX, 130) + 60, 820);
  const { canvas, redraw } = drawing(frame, height, (context, width, tall) => {
    const scale = Math.min((width - 60) / spanX, spanY > 0 ? (tall - 60) / spanY : Infinity, 130);
    const [x0, y0] = [(width - spanX * scale) / 2, (tall - spanY * scale) / 2];
    places = pes.map((pe) => [x0 + (pe.x - left) * scale, y0 + (pe.y - top) * scale]);
    radius = Math.min(Math.max(scale * 0.3, 3), 16);
    const shown = near ?? kept;
    context.clearRect(0, 0, width, tall);
    for (const [from, to, words] of links) {
      const own = shown !== null && (from === shown || to === shown);
      const tone = shown === null ? (dense ? '#e2e2e2' : '#8a8a8a') : own ? '#b4500f' : '#e6e6e6';
      context.strokeStyle = tone;
      context.fillStyle = tone;
      arrow(context, places[from], places[to], radius, 0.6 + 2.2 * Math.sqrt(words / most) * Math.min(1, radius / 8));
    }
    pes.forEach(({ load, input, outputs }, pe) => {
      const [x, y] = places[pe];
      const share = high > low ? (load - low) / (high - low) : 0.5;
      const outline = (r) => {
        context.beginPath();
        if (input) context.rect(x - r, y - r, 2 * r, 2 * r);
        else context.arc(x, y, r, 0, 2 * Math.PI);
      };
      context.strokeStyle = pe === shown ? '#b4500f' : INK;
      context.lineWidth = pe === shown ? 2.5 : 1;
      if (outputs.length > 0) {
        outline(radius + 2.5);
        context.fillStyle = '#fff';
        context.fill();
        context.stroke();
      }
      outline(radius);
      context.fillStyle = shadeColour(0.08 + 0.84 * share);
      context.fill();
      context.stroke();
      if (radius >= 8) {
        context.fillStyle = share > 0.5 ? '#fff' : INK;
        context.font = `${radius * 0.9}px system-ui, sans-serif`;
        context.textAlign = 'center';
        context.textBaseline = 'middle';
        context.fillText(String(pe), x, y);
      }
    });
  });
  canvas.classList.add('network');
  const under = (event) => {
    const [x, y] = [event.offsetX, event.offsetY];
    let [best, least] = [null, (radius + 5) ** 2];
    places.forEach(([px, py], pe) => {
      const distance = (px - x) ** 2 + (py - y) ** 2;
      if (distance <= least) [best, least] = [pe, distance];
    });
    return best;
  };
  canvas.addEventListener('mousemove', (event) => {
    const pe = under(event);
    showTip(pe === null ? null : aboutPe(network, pe, period), event);
    if (pe !== near) {
      near = pe;
      redraw();
    }
  });
  canvas.addEventListener('mouseleave', () => {
    showTip(null);
    near = null;
    redraw();
  });
  canvas.addEventListener('click', (event) => {
    kept = under(event);
    reading.textContent = kept === null ? 'Point at a PE.' : aboutPe(network, kept, period).join('; ');
    redraw();
  });
}

const LANES = [
  { key: 'products', name: 'product', colour: '#8cafd7', top: 0.06, height: 0.46 },
  { key: 'writes', name: 'write of a result', colour: '#1a1a1a', top: 0.52, height: 0.2 },
  { key: 'receives', name: 'receive from another PE or an input', colour: '#c85a14', top: 0.74, height: 0.2 },
];

function occupancySection({ occupancy, period, network }) {
  const { names, pes } = occupancy;
  const cut = pes.length < network.pes.length ? ` The first ${pes.length} of ${network.pes.length} PEs are shown, to keep the page small.` : '';
  const box = section('Occupancy', `What every PE does in every cycle of a step; white is idle. The chain under the pointer is named, and stands out wherever it is at work.${cut}`);
  const wide = element('input', { type: 'range', min: 0, max: 100, value: 0, 'aria-label': 'zoom', class: 'zoom' });
  const from = element('input', { type: 'range', min: 0, max: 1000, value: 0, 'aria-label': 'first cycle' });
  const reading = element('p', { class: 'reading' }, 'Point at a cycle.');
  const frame = element('div');
  box.append(legend(LANES.map(({ name, colour }) => [name, { colour, dash: [], width: 8 }])), frame, reading,
    element('div', { class: 'controls' }, element('label', {}, 'Zoom', wide), element('label', {}, 'Move', from)));
  const row = Math.min(Math.max(900 / pes.length, 3), 26);
  const margin = 46;
  let [near, scale] = [null, 1];
  const shown = () => {
    const cycles = Math.max(Math.min(period, 16), period * (16 / Math.max(period, 16)) ** (wide.value / 100));
    return { cycles, first: (from.value / 1000) * (period - cycles) };
  };
  const { canvas, redraw } = drawing(frame, pes.length * row + 40, (context, width, tall) => {
    const { cycles, first } = shown();
    scale = (width - margin - 6) / cycles;
    const x = (cycle) => margin + (cycle - first) * scale;
    context.clearRect(0, 0, width, tall);
    context.font = '11px system-ui, sans-serif';
    context.fillStyle = INK;
    context.textAlign = 'center';
    context.textBaseline = 'top';
    for (const tick of ticks(first, first + cycles, Math.max(3, width / 80), false)) {
      context.fillStyle = GRID;
      context.fillRect(x(tick), 0, 1, pes.length * row + 4);
      context.fillStyle = INK;
      context.fillText(String(tick), x(tick), pes.length * row + 6);
    }
    context.fillText('cycle of the step', margin + (width - margin) / 2, pes.length * row + 22);
    const every = Math.ceil(13 / row);
    context.textAlign = 'right';
    context.textBaseline = 'middle';
    pes.forEach((_, pe) => { if (pe % every === 0) context.fillText(`PE ${pe}`, margin - 6, (pe + 0.5) * row); });
    context.save();
    context.beginPath();
    context.rect(margin, 0, width - margin - 6, pes.length * row);
    context.clip();
    pes.forEach((work, pe) => {
      for (const { key, colour, top, height } of LANES) {
        const runs = work[key];
        for (let at = 0; at < runs.length; at += 3) {
          context.fillStyle = runs[at + 2] === near ? '#d4006a' : colour;
          context.fillRect(x(runs[at]), (pe + top) * row, Math.max(runs[at + 1] * scale, 0.4), height * row);
        }
      }
    });
    context.restore();
    context.strokeStyle = SOFT;
    context.strokeRect(margin, 0.5, width - margin - 6, pes.length * row);
  });
  canvas.classList.add('occupancy');
  const at = (runs, cycle) => {
    for (let place = 0; place < runs.length; place += 3) {
      if (runs[place] <= cycle && cycle < runs[place] + runs[place + 1]) return runs[place + 2];
    }
    return null;
  };
  canvas.addEventListener('mousemove', (event) => {
    const pe = Math.floor(event.offsetY / row);
    const cycle = Math.floor(shown().first + (event.offsetX - margin) / scale);
    if (!pes[pe] || event.offsetX < margin || cycle < 0 || cycle >= period) return showTip(null);
    const lane = (event.offsetY / row) % 1;
    const found = LANES.map(({ key }) => at(pes[pe][key], cycle));
    const meant = lane < 0.52 ? 0 : lane < 0.73 ? 1 : 2;
    const lines = [
      `PE ${pe}, cycle ${cycle}`,
      ...['product of the chain', 'writes', 'receives'].flatMap((what, which) => (found[which] === null ? [] : [`${what} ${names[found[which]]}`])),
    ];
    if (lines.length === 1) lines.push('idle');
    showTip(lines, event);
    reading.textContent = lines.join('; ');
    const next = found[meant] ?? found.find((name) => name !== null) ?? null;
    if (next !== near) {
      near = next;
      redraw();
    }
    return undefined;
  });
  canvas.addEventListener('mouseleave', () => {
    showTip(null);
    near = null;
    redraw();
  });
  [wide, from].forEach((slider) => slider.addEventListener('input', redraw));
}
