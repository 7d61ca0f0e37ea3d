// All printers, a tile each.
//
// Takes: the store. Gives: tiles that lead to the printers.
// Does not know: what can be done with a printer.

import { el } from './dom.js';
import { W } from './words.js';
import { store } from './live.js';
import { wantsWord } from './attention.js';
import { facts, printerPill, progressBar } from './progress.js';
import { clock } from './format.js';

export const title = () => W.printers.title;

/** What of a printer wants a person, in few words. */
function needs(printer) {
  const jobs = [...store.jobs.values()].filter((job) => job.printer === printer.id);
  const next = store.jobs.get(printer.queue.find((job) => store.jobs.get(job)?.state === 'queued'));
  const undecided = jobs.filter(({ state }) => state === 'held' || state === 'mended').length;
  return [
    printer.question?.text, printer.waits_for_user, printer.plan && W.recover.planTitle, printer.error,
    jobs.some(({ state }) => state === 'interrupted') && W.printers.interrupted,
    printer.state === 'ready' && printer.queue.length > 0 && wantsWord(printer, next) && (printer.kind === 'msla' ? W.printers.plate : W.printers.bed),
    undecided > 0 && W.printers.heldJobs(undecided),
  ].filter(Boolean);
}

function tile(scope, id) {
  const printer = () => store.printers.get(id) ?? {};
  const job = () => store.jobs.get(printer().job);
  const stale = scope.text(() => (store.stale ? W.connection.stale(clock(new Date(store.heardMs), true)) : ''), 'span', { class: 'as-of' });
  const bar = progressBar(scope, id);
  scope.watch(() => Boolean(printer().progress), (running) => { bar.hidden = !running; });
  return el('li', { class: 'tile panel' },
    el('div', { class: 'between' },
      el('h2', {}, el('a', { class: 'cover', href: `#/printer/${encodeURIComponent(id)}` }, scope.text(() => printer().name))),
      scope.part(() => [printer().state, printer().state_words, job()?.state, job()?.state_words], () => printerPill(printer(), job()), {}, 'span')),
    scope.text(() => job()?.name ?? (printer().queue?.length ? W.printers.waiting(printer().queue.length) : W.printers.idle), 'p', { class: 'tile-job clip' }),
    bar,
    facts(scope, id),
    scope.part(() => needs(printer()), (list) => list.map((words) => el('li', {}, words)), { class: 'needs', 'aria-label': W.printers.attention }, 'ul'),
    stale);
}

export function view(scope) {
  return [
    el('h1', { tabindex: -1 }, W.printers.title),
    scope.part(() => [...store.printers.keys()], (ids, inner) => {
      if (!ids.length) return el('div', { class: 'empty' }, el('h2', {}, W.printers.none), el('p', {}, W.printers.noneTells));
      return el('ul', { class: 'tiles' }, ids.map((id) => tile(inner, id)));
    }),
  ];
}
