// What the check found of a file for a printer, in plain words.
//
// Takes: functions that give the file and the printer's id. Gives: the panel, and a short word for lists.
// Does not know: the detectors; sentences are the daemon's, and only put in order here.

import { el, section } from './dom.js';
import { W } from './words.js';
import { mm, number, sentence } from './format.js';
import { pill } from './progress.js';

const TONE = { waiting: 'calm', checking: 'live', clean: 'good', found: 'warn', failed: 'bad' };
const SEVERITIES = ['stop', 'look', 'note'];
const SEVERITY_TONE = { stop: 'bad', look: 'warn', note: 'calm' };
// Notes of a clean file are not worth the room that they take.
const OPEN_NOTES = 3;

export function checkPill(check) {
  return check ? pill(W.check.short[check.state] ?? check.state, TONE[check.state]) : pill(W.none, 'calm');
}

export const countsOf = (check) => W.check.counts(check.islands, check.overhangs, check.printer_findings);

/** The place and size of a finding, as far as its sentence does not tell them already. */
function where({ words, layer, z_mm, line, area_mm2 }) {
  const there = (value, told) => value !== null && value !== undefined && !told.test(words);
  return [
    there(layer, /\blayer \d/) && W.check.layer(layer), there(z_mm, /\bZ \d/) && W.check.z(mm(z_mm)),
    line > 0 && there(line, /\bline \d/) && W.check.line(number(line)),
    area_mm2 > 0 && there(area_mm2, /\d mm²/) && W.check.area(number(area_mm2, area_mm2 < 10 ? 2 : 0)),
  ].filter(Boolean).join(' · ');
}

function finding(one) {
  const known = SEVERITIES.includes(one.severity) ? one.severity : 'look';
  const place = where(one);
  return el('li', { class: 'finding' }, pill(W.check.severity[known], SEVERITY_TONE[known]), el('div', {}, el('p', {}, sentence(one.words)), place && el('p', { class: 'faint' }, place)));
}

function body(check, file, printer) {
  if (!check) return el('p', { class: 'faint' }, file ? W.check.none : W.job.fileGone);
  if (check.state === 'waiting' || check.state === 'checking') return el('p', { class: check.state === 'checking' ? 'working' : '' }, W.check[check.state]);
  if (check.state === 'failed') return el('div', { class: 'box bad' }, el('p', {}, el('strong', {}, W.check.failed), ' ', check.words), el('p', {}, el('strong', {}, `${W.job.todo}: `), W.jobTodo.check));
  const findings = [...check.findings ?? []].sort((a, b) => SEVERITIES.indexOf(a.severity) - SEVERITIES.indexOf(b.severity));
  const weighty = findings.filter(({ severity }) => severity !== 'note');
  const notes = findings.filter(({ severity }) => severity === 'note');
  const total = (check.islands ?? 0) + (check.overhangs ?? 0) + (check.printer_findings ?? 0);
  const report = `/api/v2/files/${encodeURIComponent(file.id)}/check?printer=${encodeURIComponent(printer)}`;
  return [
    el('p', { class: 'verdict' }, countsOf(check) ? `${countsOf(check)}.` : W.check.clean),
    weighty.length > 0 && el('ul', { class: 'findings', 'aria-label': W.check.list }, weighty.map(finding)),
    total > weighty.length && weighty.length > 0 && el('p', { class: 'faint' }, W.check.more(total - weighty.length)),
    notes.length > 0 && el('details', notes.length <= OPEN_NOTES ? { open: true } : {}, el('summary', {}, W.check.notes(notes.length)), el('ul', { class: 'findings' }, notes.map(finding))),
    el('p', { class: 'faint between' }, el('span', {}, Number.isFinite(check.seconds) ? (check.seconds < 0.1 ? W.check.atOnce : W.check.seconds(number(check.seconds, 1))) : ''),
      el('a', { href: report, target: '_blank', rel: 'noopener', data: { key: 'report' } }, W.check.report)),
  ];
}

export function checkPanel(scope, file, printer) {
  return section(W.job.check, { cls: 'check' }, scope.part(() => {
    const one = file();
    return { check: one?.checks?.[printer()] ?? null, file: one ? { id: one.id } : null, printer: printer() };
  }, (what) => body(what.check, what.file, what.printer)));
}
