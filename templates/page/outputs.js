// The outputs of a design: curves over time with their errors, arrays as maps of shades.

const SHOWN_CURVES = 8;
const DOUBLE = { colour: '#bdbdbd', width: 5, dash: [] };
const FIXED = { colour: INK, width: 1.4, dash: [] };
const DIFFERENCE = { colour: '#b4500f', width: 1, dash: [] };

function curvesSection({ times, curves, arrays, left }) {
  if (curves.length === 0) return;
  const told = left > 0 ? ` ${left} more outputs are not here, to keep the page small.` : '';
  const also = arrays.length > 0 ? ' Arrays follow as maps.' : '';
  const box = section('Outputs over time', `In fixed point over double precision, and below the difference on its own scale.${also}${told} Drag to zoom, double click for the whole.`);
  const search = element('input', { type: 'search', placeholder: 'names of outputs', 'aria-label': 'Filter outputs' });
  const more = element('button', { type: 'button' }, 'more');
  const count = element('span', { class: 'told' });
  const controls = element('div', { class: 'controls' }, element('label', {}, 'Filter', search), count, more);
  const grid = element('div', { class: 'charts' });
  box.append(legend([['double precision', DOUBLE], ['fixed point', FIXED], ['difference', DIFFERENCE]]), controls, grid);
  let most = SHOWN_CURVES;
  const show = () => {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const met = curves.filter((curve) => words.every((word) => curve.name.toLowerCase().includes(word)));
    controls.hidden = curves.length <= SHOWN_CURVES;
    count.textContent = `${Math.min(most, met.length)} of ${met.length} outputs`;
    more.hidden = most >= met.length;
    grid.replaceChildren();
    for (const { name, unit, fixed, difference } of met.slice(0, most)) {
      const cell = element('div', {}, element('h3', {}, unit ? `${name} [${unit}]` : name));
      grid.append(cell);
      const double = fixed.map((value, at) => value - difference[at]);
      lines(cell, 170, ['', unit || 'value'], times, [{ name: 'double precision', values: double, look: DOUBLE }, { name: 'fixed point', values: fixed, look: FIXED }]);
      lines(cell, 110, ['time [s]', 'difference'], times, [{ name: 'fixed point minus double precision', values: difference, look: DIFFERENCE }]);
    }
  };
  search.addEventListener('input', show);
  more.addEventListener('click', () => {
    most += SHOWN_CURVES;
    show();
  });
  show();
}

function errorSection({ times, curves, arrays, looks }) {
  const all = [...curves, ...arrays].filter(({ error }) => error.some((value) => value > 0));
  if (all.length === 0) return;
  const shown = all.slice(0, 2 * looks.length);
  const cut = all.length > shown.length ? ` The first ${shown.length} of ${all.length}.` : '';
  const box = section('Word-length error over time', `Difference between fixed point and double precision, relative to the largest magnitude of the output; of an array that of its worst element.${cut}`);
  const entries = shown.map(({ name, error }, at) => {
    const { colour, dash } = looks[at % looks.length];
    return { name, values: error, look: { colour, dash, width: at < looks.length ? 1.4 : 2.6 } };
  });
  box.append(legend(entries.map(({ name, look }) => [name, look])));
  lines(box, 260, ['time [s]', 'relative error'], times, entries, true);
}

/** A field over time as numbers of 16 bits between two ends; `at(frame, cell)` is a value. */
function field({ packed, low, high }, cells) {
  const values = unpacked(packed);
  const share = (frame, cell) => values[frame * cells + cell] / 65535;
  return { low, high, share, at: (frame, cell) => low + share(frame, cell) * (high - low) };
}

function mapsSection({ times, arrays }) {
  if (arrays.length === 0) return;
  const moving = arrays.some(({ shape }) => shape.length > 1);
  const box = section('Arrays over time', `Arrays of one index have time from left to right; those of two and three show one time, which the slider sets. A click on an element shows its course.${arrays[0].frames.length < times.length ? ` ${arrays[0].frames.length} of the ${times.length} times of the curves, to keep the page small.` : ''}`);
  const time = element('input', { type: 'range', min: 0, max: Math.max(...arrays.map(({ frames }) => frames.length)) - 1, value: 0, 'aria-label': 'time', class: 'time' });
  const told = element('output');
  const what = element('select', { 'aria-label': 'what is shown', class: 'what' }, element('option', { value: 'fixed' }, 'fixed point'), element('option', { value: 'difference' }, 'fixed point minus double precision'));
  const bar = element('div', { class: 'controls' }, element('label', {}, 'Show', what));
  if (moving) bar.prepend(element('label', {}, 'Time', time, told));
  const maps = element('div', { class: 'maps' });
  const course = element('div');
  box.append(bar, maps, course);
  time.value = Math.floor(time.max / 2);
  const steps = [...new Set(arrays.map((array) => array.frames.length))].sort((a, b) => b - a)[0];
  const made = arrays.map((array) => heatMap(maps, array, times, () => ({ share: Number(time.value) / Math.max(1, steps - 1), what: what.value }), course));
  const redraw = () => {
    const longest = arrays.find(({ frames }) => frames.length === steps);
    told.textContent = `t = ${seconds(times[longest.frames[time.value]])}`;
    made.forEach((map) => map());
  };
  [time, what].forEach((input) => input.addEventListener('input', redraw));
  redraw();
}

/** One array; returns how it is drawn again. */
function heatMap(container, array, times, chosen, course) {
  const { name, unit, shape, first, frames } = array;
  const cells = shape.reduce((product, length) => product * length, 1);
  const fields = { fixed: field(array.fixed, cells), difference: field(array.difference, cells) };
  const [flat, solid] = [shape.length === 1, shape.length === 3];
  const [rows, columns] = flat ? [cells, frames.length] : shape.slice(-2);
  const size = Math.max(1, Math.floor(Math.min(flat ? 560 / columns : 380 / columns, 380 / rows, 34)));
  const [wide, tall] = flat ? [Math.max(columns * size, 420), Math.max(rows * size, Math.min(rows * 14, 240))] : [columns * size, rows * size];
  const canvas = element('canvas', { width: wide, height: tall, class: 'map' });
  canvas.style.cssText = `width: ${wide}px; height: ${tall}px; max-width: 100%; border: 1px solid #8a8a8a; cursor: crosshair`;
  const slice = element('input', { type: 'range', min: 0, max: shape[0] - 1, value: Math.floor(shape[0] / 2), 'aria-label': 'first index', class: 'slice' });
  const sliced = element('output');
  const ends = [element('span'), element('span')];
  const scale = element('canvas', { width: 120, height: 10, 'aria-hidden': 'true' });
  for (let x = 0; x < 120; x += 1) {
    scale.getContext('2d').fillStyle = shadeColour(x / 119);
    scale.getContext('2d').fillRect(x, 0, 1, 10);
  }
  const range = (axis) => `${first[axis]} to ${first[axis] + shape[axis] - 1}`;
  const about = flat ? `index ${range(0)} downwards, time ${seconds(times[frames[0]])} to ${seconds(times[frames[frames.length - 1]])} rightwards`
    : `index ${shape.length - 1} from ${range(shape.length - 2)} downwards, index ${shape.length} from ${range(shape.length - 1)} rightwards`;
  const box = element('div', {}, element('h3', {}, unit ? `${name} [${unit}]` : name), canvas,
    element('div', { class: 'scale' }, ends[0], scale, ends[1]), element('p', { class: 'note' }, about));
  if (solid) box.append(element('div', { class: 'controls' }, element('label', {}, 'index 1', slice, sliced)));
  container.append(box);
  const frame = () => Math.round(chosen().share * (frames.length - 1));
  const cell = (row, column) => (flat ? row : (solid ? Number(slice.value) * rows * columns : 0) + row * columns + column);
  const named = (at) => {
    const places = shape.map((_, axis) => Math.floor(at / shape.slice(axis + 1).reduce((product, length) => product * length, 1)) % shape[axis]);
    return `${name}[${places.map((place, axis) => place + first[axis]).join(',')}]`;
  };
  const redraw = () => {
    const shown = fields[chosen().what];
    const picture = new ImageData(columns, rows);
    for (let row = 0; row < rows; row += 1) {
      for (let column = 0; column < columns; column += 1) {
        const share = flat ? shown.share(column, row) : shown.share(frame(), cell(row, column));
        picture.data.set([...shade(share), 255], 4 * (row * columns + column));
      }
    }
    const source = element('canvas', { width: columns, height: rows });
    source.getContext('2d').putImageData(picture, 0, 0);
    const context = canvas.getContext('2d');
    context.imageSmoothingEnabled = false;
    context.drawImage(source, 0, 0, wide, tall);
    ends[0].textContent = number(shown.low);
    ends[1].textContent = number(shown.high);
    sliced.textContent = String(first[0] + Number(slice.value));
  };
  const under = (event) => {
    const box = canvas.getBoundingClientRect();
    const share = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    const [column, row] = [Math.floor(share[0] * columns), Math.floor(share[1] * rows)];
    if (column < 0 || row < 0 || column >= columns || row >= rows) return null;
    return { at: cell(row, column), frame: flat ? column : frame() };
  };
  canvas.addEventListener('mousemove', (event) => {
    const found = under(event);
    if (found === null) return showTip(null);
    const value = (what) => number(fields[what].at(found.frame, found.at));
    return showTip([`${named(found.at)} at t = ${seconds(times[frames[found.frame]])}`, `fixed point: ${value('fixed')}${unit ? ` ${unit}` : ''}`, `minus double precision: ${value('difference')}`], event);
  });
  canvas.addEventListener('mouseleave', () => showTip(null));
  canvas.addEventListener('click', (event) => {
    const found = under(event);
    if (found === null) return;
    const shown = fields[chosen().what];
    course.replaceChildren(element('h3', {}, `${named(found.at)} over time`));
    lines(course, 180, ['time [s]', unit || 'value'], frames.map((at) => times[at]), [{ name: named(found.at), values: frames.map((_, at) => shown.at(at, found.at)), look: FIXED }]);
  });
  slice.addEventListener('input', redraw);
  return redraw;
}
