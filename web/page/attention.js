// What a printer wants from a person: its question, that it waits, the bed, a job to decide, a print to go on with.
//
// Takes: a printer's id. Gives: boxes at the top of its view, the most pressing first; nothing when all goes by itself.
// Does not know: how the printer is told otherwise.

import { el } from './dom.js';
import { W } from './words.js';
import { may, printerAction } from './api.js';
import { store } from './live.js';
import { button } from './actions.js';
import { brokenOff, planOf } from './recover.js';

const box = (tone, title, ...children) => el('section', { class: `box ${tone}`, 'aria-label': title }, el('h2', {}, title), ...children);

function question(printer) {
  const { text, choices } = printer.question;
  return box('warn', W.attention.question, el('p', { class: 'large' }, text),
    may('print') && el('div', { class: 'row' }, choices.map((words, choice) => button(words, () => printerAction(printer.id, 'answer', { choice }), { kind: choice === 0 ? 'main' : '', key: `choice ${choice}` }))));
}

/**
 * The bed, or the plate, stands in the way of the next job, or of none yet; then it is told quietly. Where the printer's
 * profile has things that a person must see to before each print, the question is these.
 */
function bed(printer, next) {
  const { before, kind } = printer;
  const of = kind === 'msla' ? { title: W.attention.plate, tells: W.attention.plateTells, done: W.attention.plateDone, quiet: W.attention.plateQuiet }
    : { title: W.attention.bed, tells: W.attention.bedTells, done: W.attention.bedDone, quiet: W.attention.bedQuiet };
  const asks = next && before.length > 0;
  const clear = button(asks ? W.attention.beforeDone : of.done, () => printerAction(printer.id, 'bed_cleared'), { kind: next ? 'main' : '', key: 'bed' });
  const yes = may('print') && el('div', { class: 'row' }, clear);
  if (asks) return box('warn', W.attention.before, el('p', {}, W.attention.beforeTells(next)), el('ul', {}, before.map((what) => el('li', {}, what))), yes);
  if (next) return box('warn', of.title, el('p', {}, of.tells(next)), yes);
  return el('p', { class: 'box calm between' }, el('span', {}, of.quiet), may('print') && clear);
}

/** Whether a person's word is wanted: something may lie there, or the next job waits for what must be seen to. */
export const wantsWord = (printer, next) => !printer.bed_clear || Boolean(printer.before?.length && next && !next.prepared && !next.start_anyway);

export function attention(scope, id) {
  const what = () => {
    const printer = store.printers.get(id);
    const jobs = [...store.jobs.values()].filter((job) => job.printer === id);
    const next = store.jobs.get(printer?.queue.find((job) => store.jobs.get(job)?.state === 'queued'));
    return {
      printer: printer && { id, question: printer.question, waits: printer.waits_for_user, plan: printer.plan, idle: printer.state !== 'busy', bed: !wantsWord(printer, next), before: printer.before ?? [], kind: printer.kind, job: printer.job },
      next: next?.name ?? null,
      undecided: jobs.filter(({ state }) => state === 'held' || state === 'mended').map(({ id: job, name, state }) => ({ job, name, state })),
      broken: jobs.filter(({ state }) => state === 'interrupted').map(({ id: job }) => job),
    };
  };
  return scope.part(what, ({ printer, next, undecided, broken }) => {
    if (!printer) return [];
    return [
      printer.question && question(printer),
      printer.waits && !printer.question && box('warn', W.attention.waits, el('p', {}, printer.waits)),
      printer.plan && planOf(printer),
      broken.map((job) => brokenOff(store.jobs.get(job), printer)),
      printer.idle && !printer.bed && !broken.length && bed(printer, next),
      undecided.length > 0 && box('warn', W.attention.held, el('ul', { class: 'rows' }, undecided.map(({ job, name, state }) => el('li', { class: 'between' },
        el('span', {}, el('strong', {}, name), ' ', state === 'mended' ? W.attention.mendedReady : W.attention.heldReady),
        el('a', { class: 'button', href: `#/job/${encodeURIComponent(job)}`, 'aria-label': `${W.attention.look}: ${name}`, data: { key: job } }, W.attention.look))))),
    ];
  }, { class: 'attention' });
}
