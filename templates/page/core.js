// What all pages share: the data, elements, numbers as a person reads them, a tip beside the pointer, copying.

const data = JSON.parse(document.getElementById('data').textContent);
const main = document.getElementById('page');

// A page that fails says so: silence would look like a result.
window.addEventListener('error', (event) => {
  main.prepend(element('p', { class: 'problem' }, `This page has an error: ${event.message}`));
});

/** An element with attributes, and with children that are elements or text; names from specs only ever become text. */
function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== undefined) made.setAttribute(name, value);
  }
  // Letters that change the direction of text would show it as it is not.
  made.append(...children.map((child) => (typeof child === 'string' ? child.replace(/[\u200e\u200f\u202a-\u202e\u2066-\u2069]/g, '\ufffd') : child)));
  return made;
}

/** A section with a heading at the end of the page. */
function section(title, note) {
  const made = element('section', {}, element('h2', {}, title));
  if (note) made.append(element('p', { class: 'note' }, note));
  main.append(made);
  return made;
}

/** Rounds to three digits; what is larger or smaller than usual gets a power of ten. */
function number(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return '–';
  if (!Number.isFinite(value)) return value > 0 ? '∞' : '−∞';
  const size = Math.abs(value);
  if (size === 0) return '0';
  return size >= 1e-3 && size < 99950 ? String(Number(value.toPrecision(3))) : value.toExponential(2).replace('e+', 'e');
}

/** A number that counts something, in full. */
function count(value) {
  return value === null ? '–' : String(value);
}

/** A time in the unit that suits it. */
function seconds(value) {
  if (value === null) return '–';
  const [scale, unit] = [[1, 's'], [1e-3, 'ms'], [1e-6, 'us'], [1e-9, 'ns']].find(([scale]) => Math.abs(value) >= scale) ?? [1, 's'];
  return `${number(value / scale)} ${unit}`;
}

/** Numbers of 16 bits, packed; an array of them. */
function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Uint16Array.from({ length: bytes.length / 2 }, (_, at) => view.getUint16(2 * at, true));
}

const tip = element('div', { id: 'tip', role: 'status', hidden: '' });
document.body.append(tip);

/** Shows lines of text beside the pointer; none hides them. */
function showTip(lines, event) {
  tip.hidden = !lines;
  if (!lines) return;
  tip.textContent = lines.join('\n');
  const box = tip.getBoundingClientRect();
  const place = (at, size, room) => Math.max(4, at + 14 + size > room ? at - size - 10 : at + 14);
  tip.style.left = `${place(event.clientX, box.width, window.innerWidth)}px`;
  tip.style.top = `${place(event.clientY, box.height, window.innerHeight)}px`;
}

/** A button that copies what `text()` gives. */
function copyButton(text) {
  const button = element('button', { type: 'button', class: 'copy' }, 'Copy');
  button.addEventListener('click', async () => {
    let copied = true;
    try {
      await navigator.clipboard.writeText(text());
    } catch {
      // Pages from disk may lack the permission.
      const field = element('textarea', { style: 'position: fixed; opacity: 0' });
      field.value = text();
      document.body.append(field);
      field.select();
      copied = document.execCommand('copy');
      field.remove();
    }
    button.textContent = copied ? 'Copied' : 'Copying is not allowed: select the text';
    setTimeout(() => { button.textContent = 'Copy'; }, 1500);
  });
  return button;
}

/** A canvas of a height that fills its container; `draw(context, width, height)` is called again at every size. */
function drawing(container, height, draw) {
  const canvas = element('canvas');
  container.append(canvas);
  const redraw = () => {
    const width = room(container);
    const tall = typeof height === 'function' ? height(width) : height;
    const ratio = Math.max(window.devicePixelRatio || 1, 2);
    canvas.width = width * ratio;
    canvas.height = tall * ratio;
    canvas.style.width = `${width}px`;
    canvas.style.height = `${tall}px`;
    const context = canvas.getContext('2d');
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    draw(context, width, tall);
  };
  resized(container, redraw);
  return { canvas, redraw };
}

// Paper has a width of its own, on which everything is drawn once more.
const PAPER = 670;
let onPaper = false;
['beforeprint', 'afterprint'].forEach((event) => window.addEventListener(event, () => { onPaper = event === 'beforeprint'; }));

/** Width that there is for a drawing. */
function room(container) {
  return Math.max(onPaper ? PAPER : container.clientWidth, 50);
}

/** Calls `then` now, for paper, and whenever the width of an element changes. */
function resized(container, then) {
  let width = container.clientWidth;
  then();
  window.addEventListener('beforeprint', then);
  window.addEventListener('afterprint', then);
  new ResizeObserver(() => {
    if (!onPaper && container.clientWidth !== width && container.clientWidth > 0) {
      width = container.clientWidth;
      // Outside of the observer, which would hear of its own doing.
      requestAnimationFrame(then);
    }
  }).observe(container);
}

/** Shades from nearly white to dark blue, in order of lightness in grey, too; `share` is from 0 to 1. */
function shade(share) {
  const stops = [[247, 247, 240], [190, 215, 225], [110, 165, 205], [45, 100, 165], [15, 35, 90]];
  const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const low = Math.min(Math.floor(at), stops.length - 2);
  return stops[low].map((tone, index) => Math.round(tone + (stops[low + 1][index] - tone) * (at - low)));
}

/** A shade as a colour. */
function shadeColour(share) {
  return `rgb(${shade(share).join()})`;
}
