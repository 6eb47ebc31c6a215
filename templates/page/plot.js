// Charts: axes, zoom and cursor are those of uPlot; points with markers are drawn into its canvas.

const INK = '#1a1a1a';
const SOFT = '#5a5a5a';
const GRID = '#e4e4e4';

/** Numbers on an axis, about as many as fit: 1, 2 or 5 times a power of ten, on logarithmic axes powers of ten if need be. */
function ticks(low, high, most, logarithmic) {
  const linear = () => {
    const least = (high - low) / most;
    const power = 10 ** Math.floor(Math.log10(least));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= least * (1 - 1e-9));
    const first = Math.ceil(low / step - 1e-9);
    return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, at) => Number(((first + at) * step).toPrecision(12)));
  };
  if (!logarithmic) return linear();
  const [first, last] = [Math.floor(Math.log10(low)), Math.ceil(Math.log10(high))];
  const withDigits = (digits, every) => {
    const made = [];
    for (let power = first; power <= last; power += 1) {
      if (power % every === 0) digits.forEach((digit) => made.push(Number(`${digit}e${power}`)));
    }
    return made.filter((tick) => tick >= low && tick <= high);
  };
  const usual = withDigits([1, 2, 5], 1);
  const fine = withDigits([1, 2, 3, 4, 5, 6, 7, 8, 9], 1);
  if (fine.length < 2) return linear();
  if (usual.length < 3 && fine.length <= most) return fine;
  if (usual.length <= most) return usual;
  let every = 1;
  while (withDigits([1], every).length > most) every += 1;
  return withDigits([1], every);
}

/** Numbers on an axis, in so many digits that no two are written alike. */
function tickLabels(numbers) {
  const sizes = numbers.map(Math.abs).filter((size) => size > 0);
  const [low, high] = [Math.min(...sizes), Math.max(...sizes)];
  // Numbers of about the same size are written alike.
  const alike = high < 1e3 * low && high >= 1e-3 && high < 1e5;
  const written = (digits) => numbers.map((value) => {
    const short = Number(value.toPrecision(digits));
    const size = Math.abs(short);
    return size === 0 || alike || (size >= 1e-3 && size < 1e5) ? String(short) : short.toExponential().replace('e+', 'e');
  });
  let digits = 3;
  while (digits < 10 && new Set(written(digits)).size < numbers.length) digits += 1;
  return written(digits);
}

/** An axis of uPlot. */
function axis(name, scale, side, logarithmic) {
  const vertical = scale === 'y';
  return {
    scale,
    side,
    label: name,
    labelSize: 18,
    labelGap: vertical ? 2 : 0,
    labelFont: '12px system-ui, "DejaVu Sans", sans-serif',
    font: '11px system-ui, "DejaVu Sans", sans-serif',
    stroke: INK,
    size: vertical ? 64 : 28,
    gap: 3,
    grid: { stroke: GRID, width: 1 },
    ticks: { stroke: GRID, width: 1, size: 4 },
    splits: (chart, _, low, high) => {
      const room = (vertical ? chart.bbox.height / 28 : chart.bbox.width / 62) / devicePixelRatio;
      return ticks(low, high, Math.max(3, room), logarithmic);
    },
    // All of these have a label.
    filter: (_, splits) => splits,
    values: (_, splits) => tickLabels(splits),
  };
}

/** The outline of a marker; whether it is filled is part of its shape, so that grey prints tell them apart. */
function drawMarker(context, shape, x, y, r, colour) {
  context.beginPath();
  const polygon = (...corners) => {
    corners.forEach(([dx, dy]) => context.lineTo(x + dx * r, y + dy * r));
    context.closePath();
  };
  if (shape === 'disc' || shape === 'circle') context.arc(x, y, r, 0, 2 * Math.PI);
  else if (shape === 'square') polygon([-1, -1], [1, -1], [1, 1], [-1, 1]);
  else if (shape === 'triangle') polygon([-1.2, 1], [1.2, 1], [0, -1.2]);
  else if (shape === 'diamond') polygon([-1.35, 0], [0, -1.35], [1.35, 0], [0, 1.35]);
  else {
    context.moveTo(x - r, y - r);
    context.lineTo(x + r, y + r);
    context.moveTo(x - r, y + r);
    context.lineTo(x + r, y - r);
  }
  context.strokeStyle = colour;
  context.fillStyle = shape === 'disc' || shape === 'triangle' ? colour : '#fff';
  if (shape !== 'cross') context.fill();
  context.stroke();
}

/** A sample of a look for a legend: its marker, or its line. */
function sample({ colour, marker, dash, width }) {
  const canvas = element('canvas', { width: 56, height: 28, style: 'width: 28px; height: 14px', 'aria-hidden': 'true' });
  const context = canvas.getContext('2d');
  context.scale(2, 2);
  context.lineWidth = width ?? 1.4;
  context.strokeStyle = colour;
  if (dash) {
    context.setLineDash(dash);
    context.beginPath();
    context.moveTo(0, 7);
    context.lineTo(28, 7);
    context.stroke();
    context.setLineDash([]);
  }
  if (marker) drawMarker(context, marker, 14, 7, 3.4, colour);
  return canvas;
}

/** A legend of names and looks. */
function legend(entries) {
  return element('div', { class: 'legend' }, ...entries.map(([name, look]) => element('span', {}, sample(look), name)));
}

/** A chart of uPlot in a container, as wide as that is. */
function chart(container, height, options, values) {
  const box = element('div', { class: 'chart' });
  container.append(box);
  const made = new uPlot({ width: room(box), height, legend: { show: false }, ...options }, values, box);
  resized(box, () => made.setSize({ width: room(box), height }));
  made.over.addEventListener('mouseleave', () => showTip(null));
  return made;
}

/**
 * Points on logarithmic axes. `points()` are the rows to draw, the last ones on top; `place(row)` is [x, y], `look(row)` its
 * look; `front()` are rows that a pale line joins, `limit()` is a height that a dashed line shows, `chosen()` a row in a ring;
 * `tell(row)` are lines about a row, `pick(row)` hears of clicks.
 */
function scatter(container, names, plan) {
  const all = plan.points().map(plan.place);
  const range = (which) => {
    const shown = all.map((place) => place[which]);
    const [low, high] = shown.reduce(([low, high], at) => [Math.min(low, at), Math.max(high, at)], [Infinity, 0]);
    const space = Math.max((high / low) ** 0.05, 1.15);
    return [low / space, high * space];
  };
  const [across, up] = [range(0), range(1)];
  let near = null;
  const at = (chart, row) => {
    const [x, y] = plan.place(row);
    return [chart.valToPos(x, 'x'), chart.valToPos(y, 'y')];
  };
  const nearest = (chart) => {
    const { left, top } = chart.cursor;
    if (left === undefined || left < 0) return null;
    let [best, least] = [null, 15 ** 2];
    for (const row of plan.points()) {
      const [x, y] = at(chart, row);
      const distance = (x - left) ** 2 + (y - top) ** 2;
      if (distance <= least) [best, least] = [row, distance];
    }
    return best;
  };
  const draw = (chart) => {
    const { ctx: context, bbox: { left, top, width, height } } = chart;
    const ratio = devicePixelRatio;
    const place = (row) => at(chart, row).map((where, which) => where * ratio + (which ? top : left));
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    const front = plan.front();
    context.lineWidth = 5 * ratio;
    context.strokeStyle = '#c4c4c4';
    context.lineJoin = 'round';
    context.beginPath();
    front.forEach((row) => context.lineTo(...place(row)));
    context.stroke();
    const limit = plan.limit();
    if (limit) {
      const y = chart.valToPos(limit, 'y') * ratio + top;
      context.lineWidth = ratio;
      context.strokeStyle = SOFT;
      context.setLineDash([5 * ratio, 4 * ratio]);
      context.beginPath();
      context.moveTo(left, y);
      context.lineTo(left + width, y);
      context.stroke();
      context.setLineDash([]);
    }
    context.lineWidth = 1.4 * ratio;
    const size = (plan.points().length > 1000 ? 2.4 : 3.4) * ratio;
    for (const row of plan.points()) {
      const look = plan.look(row);
      drawMarker(context, look.marker, ...place(row), size, look.colour);
    }
    for (const row of front) drawMarker(context, plan.look(row).marker, ...place(row), 3.8 * ratio, plan.look(row).colour);
    context.strokeStyle = INK;
    for (const row of [near, plan.chosen()]) {
      if (row === null || row === undefined || !plan.points().includes(row)) continue;
      context.lineWidth = (row === near ? 1.2 : 2) * ratio;
      context.beginPath();
      context.arc(...place(row), 8 * ratio, 0, 2 * Math.PI);
      context.stroke();
    }
    context.restore();
  };
  const made = chart(container, 400, {
    scales: {
      x: { time: false, distr: 3, auto: false, range: (_, low, high) => [low ?? across[0], high ?? across[1]] },
      y: { distr: 3, auto: false, range: (_, low, high) => [low ?? up[0], high ?? up[1]] },
    },
    series: [{}, { show: true, paths: () => null, points: { show: false } }],
    axes: [axis(names[0], 'x', 2, true), axis(names[1], 'y', 3, true)],
    cursor: { drag: { x: true, y: true, uni: 20 }, points: { show: false } },
    hooks: { draw: [draw] },
  }, [across, up]);
  const whole = () => made.batch(() => {
    made.setScale('x', { min: across[0], max: across[1] });
    made.setScale('y', { min: up[0], max: up[1] });
  });
  whole();
  made.over.addEventListener('dblclick', whole);
  made.over.addEventListener('mousemove', (event) => {
    const row = nearest(made);
    showTip(row === null ? null : plan.tell(row), event);
    if (row !== near) {
      near = row;
      made.over.style.cursor = row === null ? '' : 'pointer';
      made.redraw(false);
    }
  });
  made.over.addEventListener('click', () => {
    const row = nearest(made);
    if (row !== null) plan.pick(row);
  });
  return made;
}

/** Curves over time; `curves` are { name, values, look }. With `logarithmic` what is not positive is left out. */
function lines(container, height, names, times, curves, logarithmic = false) {
  const shown = logarithmic ? curves.map(({ values }) => values.map((value) => (value > 0 ? value : null))) : curves.map(({ values }) => values);
  const range = (chart, low, high) => {
    if (low === null || low === undefined) return logarithmic ? [0.1, 1] : [-1, 1];
    if (logarithmic) return [low / 1.4, Math.max(high, low * 2) * 1.4];
    const space = high - low > 2e-6 * Math.max(Math.abs(low), Math.abs(high)) ? (high - low) * 0.06 : Math.max(Math.abs(low), Math.abs(high)) * 0.1 || 1;
    return [low - space, high + space];
  };
  const made = chart(container, height, {
    scales: { x: { time: false }, y: { distr: logarithmic ? 3 : 1, range } },
    series: [{}, ...curves.map(({ name, look }) => ({ label: name, stroke: look.colour, width: look.width ?? 1.4, dash: look.dash, points: { show: false } }))],
    axes: [axis(names[0], 'x', 2, false), axis(names[1], 'y', 3, logarithmic)],
    cursor: { sync: { key: 'time' }, points: { show: false } },
  }, [times, ...shown]);
  made.over.addEventListener('mousemove', (event) => {
    const at = made.cursor.idx;
    if (at === null || at === undefined) return showTip(null);
    const told = curves.map(({ name, values }) => `${name}: ${number(values[at])}`);
    return showTip([`t = ${seconds(times[at])}`, ...told.slice(0, 12), ...(told.length > 12 ? [`and ${told.length - 12} more`] : [])], event);
  });
  return made;
}
