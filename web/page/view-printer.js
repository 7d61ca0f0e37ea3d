// One printer: what it does now, what it wants, and everything that it can be told.
//
// Takes: the printer's id. Gives: the view, put together of the panels that other modules make.
// Does not know: what is in the panels.

import { el, section } from './dom.js';
import { W } from './words.js';
import { may } from './api.js';
import { store } from './live.js';
import { clock, when } from './format.js';
import { facts, jobPill, printerPill, progressBar } from './progress.js';
import { controls } from './controls.js';
import { attention } from './attention.js';
import { temperatureGraph } from './graph.js';
import { jogPanel } from './jog.js';
import { heatPanel } from './heat.js';
import { consolePanel } from './console.js';
import { queuePanel } from './queue.js';

const MOST_MESSAGES = 6;
const MOST_EARLIER = 8;
const ENDED = ['finished', 'cancelled', 'failed'];

export const known = (id) => store.printers.has(id);
export const selects = (id) => id;
export const title = (id) => store.printers.get(id)?.name ?? W.printers.title;

function nowPanel(scope, id) {
  const printer = () => store.printers.get(id) ?? {};
  const bar = progressBar(scope, id);
  scope.watch(() => Boolean(printer().progress), (running) => { bar.hidden = !running; });
  return section(W.printer.now, { cls: 'now' },
    scope.part(() => [printer().job, store.jobs.get(printer().job)?.name], ([job, name]) => (job
      ? el('p', { class: 'job-name' }, el('a', { href: `#/job/${encodeURIComponent(job)}`, data: { key: 'job' } }, name ?? job))
      : el('p', { class: 'faint' }, W.printer.noJob))),
    bar, facts(scope, id, { full: true }), controls(scope, id),
    scope.text(() => (store.stale ? W.connection.stale(clock(new Date(store.heardMs), true)) : ''), 'span', { class: 'as-of' }));
}

/** The camera's picture. Its address is the configuration's; what is no web address is not shown. */
function webcam(scope, id) {
  return scope.part(() => [store.printers.get(id)?.webcam_url, store.printers.get(id)?.name], ([url, name]) => {
    if (!url || !/^(https?:\/\/|\/)/.test(url)) return [];
    const image = el('img', { src: url, alt: W.printer.webcamAlt(name), class: 'webcam', referrerpolicy: 'no-referrer' });
    image.addEventListener('error', () => image.replaceWith(el('p', { class: 'faint' }, W.printer.webcamFailed)));
    return section(W.printer.webcam, {}, image);
  });
}

function messages(scope, id) {
  return scope.part(() => (store.printers.get(id)?.messages ?? []).slice(-MOST_MESSAGES).reverse(), (list) => (list.length
    ? section(W.printer.messages, {}, el('ul', { class: 'messages' }, list.map(({ at_unix_s, level, words }) => el('li', { class: level },
      el('span', { class: 'faint' }, when(at_unix_s)), level !== 'info' && el('strong', {}, W.printer.level[level] ?? level), el('span', {}, words)))))
    : []));
}

function earlier(scope, id) {
  const jobs = () => [...store.jobs.values()]
    .filter(({ printer, state }) => printer === id && ENDED.includes(state))
    .sort((a, b) => (b.ended_unix_s ?? b.created_unix_s) - (a.ended_unix_s ?? a.created_unix_s)).slice(0, MOST_EARLIER);
  return section(W.printer.history, {}, scope.part(jobs, (list) => (list.length
    ? el('ul', { class: 'rows' }, list.map((job) => el('li', { class: 'between' },
      el('a', { class: 'clip', href: `#/job/${encodeURIComponent(job.id)}`, data: { key: job.id } }, job.name),
      el('span', { class: 'row' }, el('span', { class: 'faint' }, when(job.ended_unix_s ?? job.created_unix_s)), jobPill(job)))))
    : el('p', { class: 'faint' }, W.printer.noHistory))));
}

export function view(scope, id) {
  const printer = () => store.printers.get(id) ?? {};
  const job = () => store.jobs.get(printer().job);
  // What a printer prints with does not change while the page is open.
  const melts = printer().kind !== 'msla';
  return [
    el('div', { class: 'view-head' },
      scope.text(() => printer().name, 'h1', { tabindex: -1 }),
      scope.part(() => [printer().state, printer().state_words, job()?.state, job()?.state_words], () => printerPill(printer(), job()), {}, 'span'),
      scope.text(() => [printer().profile, printer().firmware].filter(Boolean).join(' · '), 'span', { class: 'faint' })),
    attention(scope, id),
    el('div', { class: 'columns' },
      el('div', {}, nowPanel(scope, id), melts && temperatureGraph(scope, id), queuePanel(scope, id), may('control') && consolePanel(scope, id, { melts })),
      el('div', {}, webcam(scope, id), may('control') && [melts && heatPanel(scope, id), jogPanel(scope, id, { plate: !melts })], messages(scope, id), earlier(scope, id))),
  ];
}
