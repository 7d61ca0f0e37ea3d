'use strict';
// What was found, in words: the verdict, the lists, the facts. Text only ever
// enters the page as text.

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
  if (report.resin) words.push(plural(hollowsAndMore(report).length + report.resin.unlisted, 'other resin issue'));
  const text = words.join(', ');
  return text[0].toUpperCase() + text.slice(1);
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

const RESIN_TITLES = {
  island: 'Weakly held islands', overhang: 'Far overhangs', resin_trap: 'Resin traps', suction_cup: 'Suction cups',
  touching_bounds: "At the panel's edge", empty_layer: 'Empty layers', exposure: 'Odd exposures',
};

/** Resin issues but for islands that the list of islands has as well. */
function hollowsAndMore(report) {
  return report.resin.issues.filter((issue) => !issue.listed);
}

function resinRow(issue) {
  const layers = issue.end_layer > issue.layer ? `Layers ${issue.layer} to ${issue.end_layer}` : `Layer ${issue.layer}`;
  const facts = [layers, `Z ${height(issue.top_mm)}`];
  if (issue.volume_mm3) facts.push(`${mm(issue.volume_mm3, 1)} mm³`);
  else if (issue.centroid_mm) facts.push(area(issue.area_mm2));
  const colour = issue.severity === 'error' ? 'appears' : 'overhang';
  const { hole } = issue;
  const drains = hole ? ` (${mm(hole.length_mm, 1)} mm long at Z ${height(hole.top_mm)}, from ${place(hole.from_mm)} to ${place(hole.to_mm)})` : '';
  return [colour, facts.join(' · '), `${issue.centroid_mm ? `${place(issue.centroid_mm)} · ` : ''}${issue.words}${drains}`];
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
  for (const kind of Object.keys(report.resin ? RESIN_TITLES : {})) {
    const issues = hollowsAndMore(report).filter((issue) => issue.kind === kind);
    if (issues.length) at.append(findingsList(RESIN_TITLES[kind], issues, issues.length, !totals.islands, resinRow, pick));
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
