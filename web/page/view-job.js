// One job: what the check found, its picture, what to decide, and its way to the end.
//
// Takes: the job's id. Gives: the view. Findings, pictures and going on are modules of their own.
// Does not know: how anything is checked, mended or printed.

import { el, section, terms } from './dom.js';
import { W } from './words.js';
import { jobAction, may, printerAction } from './api.js';
import { store } from './live.js';
import { asking, button } from './actions.js';
import { tell } from './notice.js';
import { number, sentence, when } from './format.js';
import { facts, jobPill, progressBar } from './progress.js';
import { checkPanel } from './check.js';
import { picturePanel } from './pictures.js';
import { brokenOff, planOf } from './recover.js';
import { timeline } from './timeline.js';

const DECIDED_ELSEWHERE = ['held', 'mended', 'interrupted'];

export const known = (id) => store.jobs.has(id);
export const selects = (id) => store.jobs.get(id)?.printer ?? null;
export const title = (id) => store.jobs.get(id)?.name ?? W.shell.missing;

/** Held or mended: the choice that nobody but a person makes. */
function decision(job) {
  const act = (action) => () => jobAction(job.id, action);
  const can = (one) => may('print') && job.can.includes(one);
  const mended = job.state === 'mended';
  return el('section', { class: 'box warn decide', 'aria-label': W.job.decide },
    el('h2', {}, W.job.decide),
    mended && job.mend?.words && el('p', { class: 'large' }, sentence(job.mend.words)),
    mended && job.mend?.added_mm3 > 0 && !/\d mm³/.test(job.mend.words) && el('p', {}, W.job.added(number(job.mend.added_mm3))),
    job.mend?.state === 'failed' && el('p', {}, el('strong', {}, `${W.job.mendFailed}: `), job.mend.words, ' ', W.jobTodo.mend),
    el('p', {}, mended ? W.job.mendedTells : W.job.heldTells),
    el('div', { class: 'row' },
      !mended && can('mend') && button(W.job.mend, act('mend'), { kind: 'main' }),
      can('approve') && button(mended ? W.job.printMended : W.job.anyway, act('approve'), { kind: mended ? 'main' : '', key: 'approve' }),
      mended && can('approve') && button(W.job.asSliced, act('original')),
      can('cancel') && asking(W.job.cancel, { question: W.job.cancelAsk, yes: W.job.cancelYes, key: 'cancel' }, act('cancel'))),
    !may('print') && el('p', { class: 'reason' }, W.printer.noPrint));
}

/** What else can be done with the job as it is. */
function actions(job, plan) {
  if (!may('print')) return [];
  const plate = store.printers.get(job.printer)?.kind === 'msla';
  const can = (one) => job.can.includes(one);
  const act = (action) => () => jobAction(job.id, action);
  const again = async () => {
    const anew = await jobAction(job.id, 'again');
    tell(W.job.againDone(job.name));
    if (anew?.id) location.hash = `#/job/${encodeURIComponent(anew.id)}`;
  };
  const forget = async () => {
    await jobAction(job.id, 'forget');
    tell(W.job.forgotten);
    location.hash = `#/printer/${encodeURIComponent(job.printer)}`;
  };
  const elsewhere = DECIDED_ELSEWHERE.includes(job.state) || plan;
  const buttons = [
    can('pause') && button(W.printer.pause, () => printerAction(job.printer, 'pause'), { kind: 'main', key: 'pause' }),
    !elsewhere && can('resume') && button(W.printer.resume, () => printerAction(job.printer, 'resume'), { kind: 'main', key: 'pause' }),
    can('start') && button(plate ? W.job.startPlate : W.job.start, act('start'), { key: 'start' }),
    can('again') && button(W.job.again, again, { kind: 'main' }),
    !elsewhere && can('cancel') && asking(W.job.cancel, { question: W.job.cancelAsk, yes: W.job.cancelYes, key: 'cancel' }, act('cancel')),
    can('forget') && may('admin') && asking(W.job.forget, { question: W.job.forgetAsk, yes: W.job.forgetYes, key: 'forget' }, forget),
  ].filter(Boolean);
  return [buttons.length > 0 && el('div', { class: 'row' }, buttons), can('start') && el('p', { class: 'faint' }, plate ? W.job.startPlateTells : W.job.startTells)];
}

function statePanel(scope, id) {
  const job = () => store.jobs.get(id) ?? {};
  const has = () => store.printers.get(job().printer)?.job === id;
  const plan = () => (has() ? store.printers.get(job().printer).plan : null);
  const what = () => {
    const { state, state_words, waits_for, can, mend, error } = job();
    return { state, state_words, waits_for, can, mend, error, plan: plan() };
  };
  const bar = el('div', {}, progressBar(scope, job().printer), facts(scope, job().printer));
  scope.watch(() => has() && Boolean(store.printers.get(job().printer).progress), (running) => { bar.hidden = !running; });
  const stateTells = (state) => (store.printers.get(job().printer)?.kind === 'msla' && W.resinState[state]) || W.jobState[state][1];
  const words = scope.part(what, ({ state, state_words, waits_for, error, plan: awaited }) => [
    el('p', { class: 'large' }, sentence(state_words) || W.jobState[state]?.[1] || state),
    state_words && W.jobState[state] && !DECIDED_ELSEWHERE.includes(state) && el('p', { class: 'faint' }, stateTells(state)),
    waits_for && !DECIDED_ELSEWHERE.includes(state) && el('p', {}, W.job.waitsFor(waits_for)),
    error && state !== 'interrupted' && el('div', { class: 'box bad' }, el('h2', {}, W.job.error), el('p', {}, error), W.jobTodo[state] && el('p', {}, el('strong', {}, `${W.job.todo}: `), W.jobTodo[state])),
    awaited && planOf(store.printers.get(job().printer)),
    state === 'interrupted' && !awaited && brokenOff(job(), store.printers.get(job().printer)),
    (state === 'held' || state === 'mended') && decision(job()),
  ]);
  return el('div', { class: 'panel state' }, words, bar, scope.part(() => [what(), job().state], () => actions(job(), plan())));
}

export function view(scope, id) {
  const job = () => store.jobs.get(id) ?? {};
  const printerName = () => store.printers.get(job().printer)?.name ?? job().printer;
  return [
    el('div', { class: 'view-head' },
      scope.text(() => job().name, 'h1', { tabindex: -1 }),
      scope.part(() => [job().state, job().state_words], () => jobPill(job()), {}, 'span')),
    el('div', { class: 'columns job' },
      el('div', {}, statePanel(scope, id), checkPanel(scope, () => store.files.get(job().file), () => job().printer)),
      picturePanel(scope, id),
      el('div', {}, timeline(scope, id),
        section(W.job.about, { cls: 'plain' }, scope.part(() => [printerName(), job().by, job().created_unix_s, job().record, job().printed], () => terms(
          [W.job.on, el('a', { href: `#/printer/${encodeURIComponent(job().printer)}`, data: { key: 'printer' } }, printerName())],
          [W.job.by, job().by], [W.job.created, when(job().created_unix_s)],
          job().record !== null && job().record !== undefined && [W.job.record, String(job().record)],
          [W.job.printedAs, W.job.printed[job().printed] ?? job().printed]))))),
  ];
}
