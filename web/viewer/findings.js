'use strict';
// What was found, in words: the verdict, the lists, the facts. Text only ever
// enters the page as text.

/** An element with attributes and children; strings become text. */
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === 'onclick') made.addEventListener('click', value);
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

function plural(count, one, many = `${one}s`) {
  return `${count === 0 ? 'no' : count.toLocaleString('en')} ${count === 1 ? one : many}`;
}

/** Areas of all sizes with three digits or so. */
function area(value) {
  return `${mm(value, value < 0.1 ? 4 : value < 10 ? 2 : 1)} mm²`;
}

function place([x, y]) {
  return `X ${mm(x, 1)} Y ${mm(y, 1)}`;
}

/** One line of facts below the name. */
function factsOf(report) {
  const facts = [report.kind];
  if (report.triangles != null) facts.push(plural(report.triangles, 'triangle'));
  facts.push(plural(report.layers, 'layer'), `${mm(report.height_mm)} mm high`, report.rules.material);
  return facts.join(' · ');
}

function verdictOf(job) {
  const { report, totals } = job;
  const words = [plural(totals.islands, 'island')];
  if (report.overhangs) words.push(plural(report.overhangs.regions, 'overhang'));
  const text = words.join(', ');
  return text[0].toUpperCase() + text.slice(1);
}

/** A list of findings that go to their place when clicked. */
function findingsList(title, items, total, open, row, onPick) {
  const list = element('ol', { class: 'found' });
  for (const item of items) {
    const [kind, heading, rest] = row(item);
    const swatch = element('span', { class: 'swatch', style: `background: var(--${kind})` });
    const words = element('span', {}, heading, element('small', {}, rest));
    const button = element('button', { type: 'button', onclick: () => onPick(item, button) }, swatch, words);
    list.append(element('li', {}, button));
  }
  const details = element('details', open ? { open: '' } : {}, element('summary', {}, `${title} (${total.toLocaleString('en')})`), list);
  if (items.length < total) {
    details.append(element('p', { class: 'help' }, `The ${items.length} largest of ${total}; all are in the report of --json.`));
  }
  return details;
}

function islandRow(island) {
  const grows = island.max_area_mm2 > 2 * island.area_mm2 ? ` · grows to ${area(island.max_area_mm2)}` : '';
  const end = island.joins ? `joins the part at Z ${height(island.end_top_mm)}` : 'never joins the part';
  return ['appears', `Layer ${island.layer} · Z ${height(island.top_mm)} · ${area(island.area_mm2)}`, `${place(island.centroid_mm)}${grows} · ${end}`];
}

function regionRow(region) {
  const layers = region.end_layer > region.layer ? `layers ${region.layer} to ${region.end_layer}` : `layer ${region.layer}`;
  return ['overhang', `Layer ${region.layer} · Z ${height(region.top_mm)} · ${area(region.area_mm2)}`, `${place(region.centroid_mm)} · ${layers}`];
}

/** Names and values. */
function table(title, rows) {
  const list = element('dl');
  for (const [name, value] of rows) list.append(element('dt', {}, name), element('dd', {}, value));
  return element('details', {}, element('summary', {}, title), list);
}

/** Fills the side of the page. `onPick(finding)` goes to its place. */
function fillFindings(job, onPick) {
  const { report, totals } = job;
  document.getElementById('verdict').textContent = verdictOf(job);
  const warnings = document.getElementById('warnings');
  for (const warning of report.warnings) warnings.append(element('li', {}, warning));
  warnings.hidden = !report.warnings.length;
  let current = null;
  const pick = (item, button) => {
    current?.removeAttribute('aria-current');
    current = button;
    button.setAttribute('aria-current', 'true');
    onPick(item);
  };
  const at = document.getElementById('findings');
  if (totals.islands) at.append(findingsList('Islands', report.islands, totals.islands, true, islandRow, pick));
  if (totals.small_islands) {
    const title = `Islands below ${report.rules.min_area_mm2} mm²`;
    at.append(findingsList(title, report.small_islands, totals.small_islands, false, islandRow, pick));
  }
  if (report.overhangs?.regions) {
    const { method, largest, regions } = report.overhangs;
    at.append(findingsList(`Overhangs by ${method}`, largest, regions, !totals.islands, regionRow, pick));
  }
  const rules = [
    ['material', report.rules.material],
    ['holds itself up to', `${report.rules.angle_deg}° from the vertical`],
    ['bridges', `${report.rules.bridge_mm} mm`],
    ['smallest area', `${report.rules.min_area_mm2} mm²`],
  ];
  at.append(table('Rules', rules));
  at.append(table('Seconds', Object.entries(report.seconds).map(([name, s]) => [name, s.toFixed(3)])));
}
