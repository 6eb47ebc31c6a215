// The page of a sweep: a slider for the error that moves the fronts, two charts, the table, and the point that was chosen.

/**
 * The rows that no other row beats in one figure without losing in the other, from small to large in the first: the rule of
 * `pe_flow::explore::fronts`, of which the files hold the result at the sweep's own limit.
 */
function frontOf(rows, first, second) {
  const known = rows.filter((row) => [first, second].every((column) => column.at(row) !== null && Number.isFinite(column.at(row))));
  known.sort((a, b) => first.at(a) - first.at(b) || second.at(a) - second.at(b) || a - b);
  let least = Infinity;
  return known.filter((row) => {
    const better = second.at(row) < least;
    least = Math.min(least, second.at(row));
    return better;
  });
}

function sweepPage() {
  const columns = columnsOf(data.columns);
  const column = Object.fromEntries(columns.map((one) => [one.key, one]));
  const rows = Array.from({ length: columns[0].length }, (_, row) => row);
  const error = column[data.error];
  const errors = rows.map(error.at).filter((value) => value > 0 && Number.isFinite(value));
  const state = { limit: data.limit, chosen: null, fronts: [], colour: null };
  const within = (row, limit) => limit === null || (error.at(row) !== null && error.at(row) <= limit);
  const named = (one, row) => (one.kind === 'count' ? `${one.shown(row)} ${one.name}`.replace(/^1 (.*)s$/, '1 $1') : one.shown(row));
  const name = (row) => data.naming.map((key) => named(column[key], row)).filter(Boolean).join(', ');
  const plots = data.plots.map((plan) => {
    const places = rows.map((row) => [column[plan.x].at(row), column[plan.y].at(row)]);
    return { ...plan, places, points: rows.filter((row) => places[row].every((at) => at > 0 && Number.isFinite(at))) };
  });

  // Which point is meant, in one place.
  const pick = (row) => {
    state.chosen = row;
    table.choose(row, true);
    charts.forEach((made) => made.redraw(false));
    show(row);
  };
  const controls = limits(errors, state, () => {
    move();
    charts.forEach((made) => made.redraw(false));
    table.arrange();
  });
  const fastest = element('p', { class: 'fastest' });
  main.append(controls.bar, fastest);

  const move = () => {
    state.fronts = plots.map((plan) => {
      const limit = plan.least === undefined ? null : state.limit === null ? null : Math.max(state.limit, plan.least);
      return frontOf(plan.points.filter((row) => within(row, limit)), column[plan.x], column[plan.y]);
    });
    state.on = new Set(state.fronts.flat());
    const met = plots[0].points.filter((row) => within(row, state.limit));
    const time = column[plots[0].x];
    const best = met.reduce((best, row) => (best === null || time.at(row) < time.at(best) ? row : best), null);
    const bound = state.limit === null ? 'of any error' : `with a total error of at most ${number(state.limit)}`;
    fastest.replaceChildren(`${met.length} points ${bound}. `);
    if (best === null) return;
    const button = element('button', { type: 'button' }, name(best));
    button.addEventListener('click', () => pick(best));
    fastest.append('The fastest: ', button, ` ${time.name} ${time.shown(best)}, error ${error.shown(best)}.`);
  };

  const keys = data.colours.filter((key) => new Set(rows.map(column[key].at)).size > 1);
  const choice = colouring(column, keys.length > 0 ? keys : [data.colours[0]], () => {
    charts.forEach((made) => made.redraw(false));
  });
  main.append(choice.bar);
  const grid = element('div', { class: 'charts' });
  main.append(grid);
  move();
  const charts = plots.filter((plan) => plan.points.length > 0).map((plan) => {
    const own = plots.indexOf(plan);
    const box = element('section', {}, element('h2', {}, plan.title));
    grid.append(box);
    const made = scatter(box, plan.names, {
      points: () => plan.points,
      place: (row) => plan.places[row],
      look: choice.look,
      front: () => state.fronts[own],
      limit: () => (plan.y === data.error ? state.limit : null),
      chosen: () => state.chosen,
      tell: (row) => data.telling.map((key) => `${column[key].name}: ${column[key].shown(row)}`),
      pick,
    });
    const lacking = rows.length - plan.points.length;
    const lacks = lacking > 0 ? ` ${lacking} of ${rows.length} points lack one of both figures and are in the table only.` : '';
    box.append(element('p', { class: 'note' }, `Pale line: the Pareto front. Drag to zoom, double click for the whole; a click chooses a point.${lacks}`));
    return made;
  });

  const detail = element('section', { class: 'point', hidden: '' });
  main.append(detail);
  const show = (row) => {
    detail.hidden = false;
    const command = column.command.at(row);
    const facts = element('dl', { class: 'facts' }, ...columns.filter(({ key }) => key !== 'command').map((one) => {
      const text = one.shown(row);
      return element('div', {}, element('dt', {}, one.name), element('dd', {}, text === '' ? '–' : text));
    }));
    detail.replaceChildren(
      element('h2', {}, `Point ${column.point.at(row)}: ${name(row)}`),
      element('div', { class: 'command' }, element('code', {}, command), copyButton(() => command)),
      element('p', { class: 'note' }, 'The report of this point; all digits and further figures are in ', element('a', { href: data.report }, data.report), '. The command writes the design.'),
      facts);
  };

  const box = section('All points', `A click on a head sorts, one on a row shows its command and report. Bold rows are on a front. The filter takes words and comparisons by the names of columns in ${data.file}.`);
  const only = element('input', { type: 'checkbox', class: 'only-fronts' });
  const right = element('input', { type: 'checkbox', class: 'only-right' });
  [only, right].forEach((input) => input.addEventListener('change', () => table.arrange()));
  const table = new Table(box, columns, {
    pick: (row) => {
      pick(row);
      detail.scrollIntoView({ block: 'nearest' });
    },
    mark: (row) => state.on.has(row),
    controls: [element('label', {}, only, 'on a front'), element('label', {}, right, 'within the error')],
    file: data.file,
  });
  table.within = (row) => (!only.checked || state.on.has(row)) && (!right.checked || within(row, state.limit));
  if (data.chosen !== null) pick(data.chosen);
}

/** The slider for the largest error: on a logarithmic scale, with all points at its right end. */
function limits(errors, state, changed) {
  const slider = element('input', { type: 'range', min: 0, max: 1000, step: 1, 'aria-label': 'largest total error', class: 'limit' });
  const told = element('output');
  const [low, high] = errors.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, 0]);
  const [from, to] = [Math.log10(low) - 0.02, Math.log10(high) + 0.02];
  const tell = () => { told.textContent = state.limit === null ? 'any' : `at most ${number(state.limit)}`; };
  slider.value = state.limit === null ? 1000 : Math.round(1000 * Math.min(Math.max((Math.log10(state.limit) - from) / (to - from), 0), 0.999));
  slider.addEventListener('input', () => {
    const share = Number(slider.value) / 1000;
    state.limit = share >= 1 ? null : 10 ** (from + share * (to - from));
    tell();
    changed();
  });
  tell();
  const bar = element('div', { class: 'controls' }, element('label', {}, 'Total error', slider, told));
  const reset = element('button', { type: 'button' }, 'as asked for');
  const asked = state.limit;
  const start = slider.value;
  reset.addEventListener('click', () => {
    slider.value = start;
    state.limit = asked;
    tell();
    changed();
  });
  bar.append(reset);
  bar.hidden = errors.length === 0;
  return { bar };
}

/** What tells points apart: a choice of columns, and the looks of their values. Solvers of a family share a colour. */
function colouring(column, keys, changed) {
  const select = element('select', { 'aria-label': 'told apart by' });
  keys.forEach((key) => select.append(element('option', { value: key }, column[key].name)));
  const shown = element('div');
  const bar = element('div', {}, element('div', { class: 'controls' }, element('label', {}, 'Points by', select)), shown);
  let looks;
  const other = { ...data.looks[data.looks.length - 1], colour: '#9a9a9a' };
  const choose = () => {
    const key = select.value;
    const values = [...new Set(Array.from({ length: column[key].length }, (_, row) => column[key].at(row)))].filter((value) => value !== null && value !== '');
    if (key !== 'solver') values.sort((a, b) => (a < b ? -1 : 1));
    looks = new Map(values.map((value, at) => [value, key === 'solver' ? data.solvers[value] ?? other : data.looks[at] ?? other]));
    const named = values.map((value) => [String(value), looks.get(value)]);
    const most = data.looks.length;
    const entries = key === 'solver' ? named.map(([text, look]) => [text, { ...look, dash: undefined }]) : named.slice(0, most);
    if (entries.length < named.length) entries.push([`${named.length - entries.length} more`, other]);
    shown.replaceChildren(legend(entries.map(([text, look]) => [text, { ...look, dash: undefined }])));
  };
  select.addEventListener('change', () => {
    choose();
    changed();
  });
  choose();
  return { bar, look: (row) => looks.get(column[select.value].at(row)) ?? other };
}
