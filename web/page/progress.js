// How far a printer is: state, bar, layer, times, temperatures.
//
// Takes: a printer's id and the store. Gives: elements whose texts change in place, so that nothing that has the
// focus or is pressed at the moment is drawn away.
// Does not know: actions.

import { el } from './dom.js';
import { W } from './words.js';
import { endsAt, heater, mm, number, percent, span } from './format.js';

const TONES = {
  ready: 'good', busy: 'live', failed: 'bad', offline: 'calm', connecting: 'calm',
  printing: 'live', starting: 'live', resuming: 'live', recovering: 'live', taking_over: 'live', ending: 'live',
  held: 'warn', mended: 'warn', paused: 'warn', pausing: 'warn', asking: 'warn', interrupted: 'warn',
  lost: 'bad', failing: 'bad', finished: 'good',
};

/** A state as a word with a mark; never by colour alone. */
export function pill(words, tone) {
  return el('span', { class: `pill ${tone ?? 'calm'}` }, words);
}

export function jobPill(job) {
  return pill(W.jobState[job.state]?.[0] ?? job.state_words ?? job.state, TONES[job.state] ?? (job.state === 'failed' ? 'bad' : 'calm'));
}

/** The state of a printer: that of its job while it has one. */
export function printerPill(printer, job) {
  if (printer.state === 'busy' && job) return jobPill(job);
  return pill(W.printerState[printer.state] ?? printer.state_words ?? printer.state, TONES[printer.state]);
}

/** A bar with a role. The width goes by the object model, which the policy of the page allows. */
export function bar(label, attributes = {}) {
  const fill = el('div', { class: 'fill' });
  const made = el('div', { class: 'bar', role: 'progressbar', 'aria-label': label, 'aria-valuemin': 0, 'aria-valuemax': 100, ...attributes }, fill);
  const set = (fraction) => {
    const known = Number.isFinite(fraction);
    made.classList.toggle('unknown', !known);
    if (known) made.setAttribute('aria-valuenow', Math.floor(fraction * 100));
    else made.removeAttribute('aria-valuenow');
    fill.style.width = known ? `${Math.min(100, Math.max(0, fraction * 100))}%` : '';
  };
  return { made, set };
}

/** The bar of a printer's job with its percentage. */
export function progressBar(scope, id) {
  const printer = () => scope.store.printers.get(id);
  const jobName = () => scope.store.jobs.get(printer()?.job)?.name ?? printer()?.name ?? '';
  const { made, set } = bar('');
  scope.watch(jobName, (name) => made.setAttribute('aria-label', W.facts.progress(name)));
  scope.watch(() => printer()?.progress?.fraction ?? null, (fraction) => set(fraction ?? NaN));
  return el('div', { class: 'progress' }, made, scope.text(() => percent(printer()?.progress?.fraction), 'span', { class: 'figure', 'aria-hidden': 'true' }));
}

/** Terms with figures that follow the printer. `full` has those that a tile leaves out. */
export function facts(scope, id, { full = false } = {}) {
  const printer = () => scope.store.printers.get(id) ?? {};
  const running = (p) => p.progress;
  const of = (a, b) => (b ? W.facts.of(number(a), number(b)) : number(a));
  const list = [
    [W.facts.layer, running, (p) => of(p.progress.layer, p.progress.layers)],
    [W.facts.z, (p) => Number.isFinite(running(p)?.z_mm), (p) => mm(p.progress.z_mm)],
    [W.facts.left, (p) => Number.isFinite(running(p)?.left_s), (p) => span(p.progress.left_s)],
    [W.facts.ends, (p) => Number.isFinite(running(p)?.left_s), (p) => endsAt(p.progress.left_s)],
    full && [W.facts.elapsed, running, (p) => span(p.progress.elapsed_s)],
    full && [W.facts.line, running, (p) => of(p.progress.line, p.progress.lines)],
    [W.facts.nozzle, (p) => p.temperatures?.nozzle, (p) => heater(p.temperatures.nozzle)],
    [W.facts.bed, (p) => p.temperatures?.bed, (p) => heater(p.temperatures.bed)],
    [W.facts.chamber, (p) => p.temperatures?.chamber, (p) => heater(p.temperatures.chamber)],
  ].filter(Boolean);
  return el('dl', { class: 'facts' }, list.map(([term, there, value]) => {
    const row = el('div', {}, el('dt', {}, term), scope.text(() => (there(printer()) ? value(printer()) : ''), 'dd'));
    scope.watch(() => Boolean(there(printer())), (shown) => { row.hidden = !shown; });
    return row;
  }));
}
