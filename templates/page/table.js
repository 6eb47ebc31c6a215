// Tables of many rows: sorted by a click on a head, filtered by words and comparisons; only rows in sight are elements.

const ROW = 26;
const PRINTED_ROWS = 100;
const WIDEST = 310;

/** Columns as they are in the data, with `at(row)` for a cell and `shown(row)` for its text. */
function columnsOf(stored) {
  return stored.map((column) => {
    let at;
    if (column.words) at = (row) => column.words[column.places[row]];
    else if (column.rest) at = (row) => column.prefix + column.rest[row];
    else {
      // JSON has no infinite numbers.
      const values = column.values.map((value) => (value === 'inf' ? Infinity : value));
      at = (row) => values[row];
    }
    const text = column.kind === 'text';
    const show = { text: (cell) => cell, number, count, seconds }[column.kind];
    const length = (column.places ?? column.rest ?? column.values).length;
    return { ...column, text, at, length, shown: (row) => show(at(row)) };
  });
}

/**
 * The rows that a filter lets through: all its words must be in the texts of a row, and all its comparisons, such as
 * `lut<5000`, must hold, by names of columns in the files. What cannot be read lets nothing through, and is told.
 */
function filtered(columns, text) {
  const rows = Array.from({ length: columns[0].length }, (_, row) => row);
  const tests = [];
  for (const word of text.toLowerCase().split(/\s+/).filter(Boolean)) {
    const parts = /^([a-z_0-9]+)(<=|>=|<|>|=)(.+)$/.exec(word);
    const column = parts && columns.find((column) => column.key === parts[1] && !column.text);
    if (column) {
      const limit = Number(parts[3]);
      if (Number.isNaN(limit)) return { rows: [], problem: `"${parts[3]}" is no number` };
      const holds = { '<': (a) => a < limit, '>': (a) => a > limit, '<=': (a) => a <= limit, '>=': (a) => a >= limit, '=': (a) => a === limit }[parts[2]];
      tests.push((row) => column.at(row) !== null && holds(column.at(row)));
    } else if (parts && !columns.some((column) => column.key === parts[1])) {
      return { rows: [], problem: `there is no column "${parts[1]}"` };
    } else {
      const wanted = parts ? parts[3] : word;
      const searched = columns.filter((column) => (parts ? column.key === parts[1] : column.text));
      const found = searched.map((column) => column.words
        ? ((hits) => (row) => hits[column.places[row]])(column.words.map((known) => known.toLowerCase().includes(wanted)))
        : (row) => column.at(row).toLowerCase().includes(wanted));
      tests.push((row) => found.some((hit) => hit(row)));
    }
  }
  return { rows: rows.filter((row) => tests.every((test) => test(row))) };
}

/** Rows in the order of a column; what has no value comes last in either direction. */
function sorted(rows, column, down) {
  const sign = down ? -1 : 1;
  const compare = column.text
    ? (a, b) => (a < b ? -1 : a > b ? 1 : 0)
    : (a, b) => a - b || 0;
  const rank = column.words && column.text
    ? ((order) => (row) => order[column.places[row]])(ranks(column.words))
    : column.at;
  const order = column.words ? (a, b) => a - b : compare;
  const missing = (value) => value === null || value === '';
  return rows.slice().sort((a, b) => {
    const [left, right] = [rank(a), rank(b)];
    if (missing(left) || missing(right)) return missing(left) - missing(right) || a - b;
    return sign * order(left, right) || a - b;
  });
}

function ranks(words) {
  const order = words.map((_, at) => at).sort((a, b) => (words[a] < words[b] ? -1 : words[a] > words[b] ? 1 : 0));
  const ranked = [];
  order.forEach((at, rank) => { ranked[at] = rank; });
  return ranked;
}

/**
 * A table of `columns` in a container. `options.pick(row)` hears of clicks, `options.mark(row)` gives the class of a row,
 * `options.cell(column, row)` may give an element in place of a text, `options.order` is the key of the column that it is
 * sorted by at first, `options.file` holds all rows.
 */
class Table {
  constructor(container, columns, options = {}) {
    this.columns = columns;
    this.options = options;
    this.visible = columns.filter((column) => column.visible);
    this.by = columns.find((column) => column.key === options.order) ?? null;
    this.down = false;
    this.query = '';
    this.within = () => true;
    this.told = element('span', { class: 'told', role: 'status' });
    this.frame = element('div', { class: 'table', tabindex: '0' });
    this.printed = element('p', { class: 'note', hidden: '' });
    this.body = element('tbody');
    this.head = element('thead');
    this.table = element('table', {}, this.head, this.body);
    this.frame.append(this.table);
    container.append(this.controls(), this.frame, this.printed);
    this.frame.addEventListener('scroll', () => this.render());
    this.frame.addEventListener('keydown', (event) => this.move(event));
    window.addEventListener('beforeprint', () => this.print(true));
    window.addEventListener('afterprint', () => this.print(false));
    this.layOut();
    this.arrange();
    resized(this.frame, () => this.render());
  }

  controls() {
    const example = this.columns.find((column) => !column.text && !column.bar && column.visible && column.key !== 'point');
    const search = element('input', { type: 'search', placeholder: `words, or ${example.key}<${number(typical(example))}`, 'aria-label': 'Filter' });
    search.addEventListener('input', () => {
      this.query = search.value;
      this.arrange();
    });
    const bar = element('div', { class: 'controls' }, element('label', {}, 'Filter', search));
    if (this.visible.length < this.columns.length) {
      const all = element('input', { type: 'checkbox', class: 'all-columns' });
      all.addEventListener('change', () => {
        this.visible = this.columns.filter((column) => all.checked || column.visible);
        this.layOut();
        this.render(true);
      });
      bar.append(element('label', {}, all, 'all columns'));
    }
    bar.append(...(this.options.controls ?? []), this.told);
    return bar;
  }

  /** Heads, and widths by a sample of the cells in the letters of a front: rows come and go, and columns shall not move. */
  layOut() {
    const rows = this.columns[0].length;
    const every = Math.max(1, Math.floor(rows / 200));
    const row = element('tr');
    const wide = boldWidth(this.frame);
    let sum = 0;
    for (const column of this.visible) {
      let text = Math.max(...column.name.split(' ').map((word) => wide(`${word} \u2195`)), wide(column.name) / 2);
      for (let at = 0; at < rows; at += every) text = Math.max(text, wide(column.shown(at)));
      const width = column.bar ? 190 : Math.ceil(Math.min(text, WIDEST) + 20);
      sum += width;
      const button = element('button', { type: 'button', title: `${column.key}: sort` }, column.name);
      button.addEventListener('click', () => {
        this.down = this.by === column && !this.down;
        this.by = column;
        this.frame.scrollTop = 0;
        this.arrange();
      });
      const cell = element('th', { class: column.text ? 'text' : undefined, style: `width: ${width}px`, scope: 'col' }, button);
      cell.dataset.key = column.key;
      row.append(cell);
    }
    this.head.replaceChildren(row);
    this.table.style.width = `${sum}px`;
  }

  /** Filters and sorts. */
  arrange() {
    const { rows, problem } = filtered(this.columns, this.query);
    const kept = rows.filter(this.within);
    this.rows = this.by ? sorted(kept, this.by, this.down) : kept;
    const all = this.columns[0].length;
    this.told.textContent = problem ?? (this.rows.length === all ? `${all} rows` : `${this.rows.length} of ${all} rows`);
    for (const cell of this.head.firstChild.children) {
      const own = this.by && cell.dataset.key === this.by.key;
      if (own) cell.setAttribute('aria-sort', this.down ? 'descending' : 'ascending');
      else cell.removeAttribute('aria-sort');
    }
    this.render(true);
  }

  /** Makes the rows in sight. */
  render(anew = false) {
    const height = this.printing ? PRINTED_ROWS * ROW : this.frame.clientHeight || 800;
    const first = this.printing ? 0 : Math.max(0, Math.floor(this.frame.scrollTop / ROW) - 8);
    const last = Math.min(this.rows.length, first + Math.ceil(height / ROW) + (this.printing ? 0 : 17));
    if (!anew && first === this.first && last === this.last) return;
    [this.first, this.last] = [first, last];
    const space = (rows) => element('tr', { class: 'space', 'aria-hidden': 'true' }, element('td', { colspan: this.visible.length, style: `height: ${rows * ROW}px` }));
    const made = this.rows.slice(first, last).map((row) => this.row(row));
    this.body.replaceChildren(
      ...(first > 0 ? [space(first)] : []), ...made,
      ...(last < this.rows.length && !this.printing ? [space(this.rows.length - last)] : []));
    this.table.setAttribute('aria-rowcount', this.rows.length);
  }

  row(row) {
    const made = element('tr');
    made.dataset.row = row;
    if (this.options.pick) made.classList.add('clickable');
    if (this.options.mark?.(row)) made.classList.add('front');
    if (row === this.chosen) made.classList.add('chosen');
    for (const column of this.visible) {
      const own = this.options.cell?.(column, row);
      const text = column.shown(row);
      made.append(element('td', { class: column.text ? 'text' : undefined, title: own ? undefined : text }, own ?? text));
    }
    if (this.options.pick) made.addEventListener('click', () => this.options.pick(row));
    return made;
  }

  /** Marks a row as chosen, and brings it into sight unless it was chosen here. */
  choose(row, scroll) {
    this.chosen = row;
    const place = this.rows.indexOf(row);
    if (scroll && place >= 0) this.frame.scrollTop = Math.max(0, place * ROW - this.frame.clientHeight / 2);
    this.render(true);
  }

  /** The arrow keys choose the next row or the one before. */
  move(event) {
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!by || !this.options.pick || this.chosen === undefined) return;
    const next = this.rows[this.rows.indexOf(this.chosen) + by];
    if (next !== undefined) {
      event.preventDefault();
      this.options.pick(next);
    }
  }

  /** On paper a table shows its first rows, and says so. */
  print(on) {
    this.printing = on;
    const file = this.options.file ? `; all are in ${this.options.file}` : '';
    this.printed.hidden = !on || this.rows.length <= PRINTED_ROWS;
    this.printed.textContent = `The first ${PRINTED_ROWS} of ${this.rows.length} rows${file}.`;
    this.render(true);
  }
}

/** What gives the width of a text in the bold letters of an element, in pixels. */
function boldWidth(of) {
  const { fontSize, fontFamily } = getComputedStyle(of);
  const pen = element('canvas').getContext('2d');
  pen.font = `600 ${fontSize || '13px'} ${fontFamily || 'sans-serif'}`;
  return (text) => pen.measureText(text).width;
}

/** Some number of a column, for an example. */
function typical(column) {
  for (let row = column.length >> 1; row < column.length; row += 1) {
    if (Number.isFinite(column.at(row)) && column.at(row) !== null) return column.at(row);
  }
  return 1;
}
