// The page of a design.

function designPage() {
  const facts = element('dl', { class: 'facts summary' }, ...data.summary.map(([name, text]) => element('div', {}, element('dt', {}, name), element('dd', {}, text.replaceAll('`', '')))));
  main.append(facts);
  const command = element('div', { class: 'command' }, element('code', {}, data.command), copyButton(() => data.command));
  main.append(command);
  curvesSection(data);
  mapsSection(data);
  errorSection(data);
  rangesSection(data);
  if (data.network) networkSection(data);
  if (data.occupancy) occupancySection(data);
  if (!data.network) section('Network and occupancy', `Not drawn: there are more than ${data.drawnPes} PEs.`);
}

function rangesSection({ ranges, variables }) {
  const cut = ranges[0].places?.length ?? ranges[0].rest.length;
  const told = cut < variables ? ` Of ${variables} variables those ${cut} with the least headroom.` : '';
  const box = section('Ranges, the least headroom first', `A bar is what a format holds; dark is the largest magnitude of the runs. Headroom is the rest, in bits.${told} The part that lifting made of an equation is named after who reads it; its formula is in the last column.`);
  const columns = columnsOf(ranges);
  const column = Object.fromEntries(columns.map((one) => [one.key, one]));
  new Table(box, columns, {
    order: 'headroom_bits',
    file: data.variablesFile,
    cell: (one, row) => {
      if (one.key !== 'bar') return null;
      const used = column.largest.at(row) / column.limit.at(row);
      return element('div', { class: 'bar', title: `${number(100 * used)} % of the range` }, element('i', { style: `width: ${(100 * used).toFixed(1)}%` }));
    },
  });
}
