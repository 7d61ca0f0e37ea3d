// Going on with a print that was broken off, in two steps: first what happened, then what will be done and a yes.
//
// Takes: the job, or the printer whose plan waits. Gives: a box with words and buttons.
// Does not know: how the daemon finds its way back into the print.

import { el } from './dom.js';
import { W } from './words.js';
import { jobAction, may, printerAction } from './api.js';
import { asking, button } from './actions.js';
import { mm, number, sentence } from './format.js';

export function brokenOff(job, printer) {
  const at = printer?.job === job.id ? printer.progress : null;
  const where = [Number.isFinite(at?.layer) && W.recover.atLayer(number(at.layer)), Number.isFinite(at?.z_mm) && W.recover.atZ(mm(at.z_mm))].filter(Boolean).join('');
  return el('section', { class: 'box warn', 'aria-label': W.recover.title },
    el('h2', {}, W.recover.title),
    el('p', {}, W.recover.tells(job.name, where), ' ', job.error ? `${sentence(job.error)}.` : W.recover.why, ' ', job.can.includes('resume') && W.recover.kept),
    job.can.includes('resume') && el('p', {}, printer?.kind === 'msla' ? W.recover.beforePlate : W.recover.before),
    may('print') && job.can.includes('resume') && el('p', { class: 'faint' }, W.recover.goTells),
    may('print') && el('div', { class: 'row' },
      job.can.includes('resume') && button(W.recover.go, () => jobAction(job.id, 'resume'), { kind: 'main', key: `go ${job.id}` }),
      job.can.includes('cancel') && asking(W.recover.giveUp, { question: W.recover.giveUpAsk, yes: W.recover.giveUpYes, key: `give up ${job.id}` }, () => jobAction(job.id, 'cancel'))),
    job.waits_for && el('p', { class: 'faint' }, W.job.waitsFor(job.waits_for)));
}

/** The plan that waits for its yes. The yes may ask for the password, since the head moves after it. */
export function planOf(printer) {
  const plate = printer.kind === 'msla';
  return el('section', { class: 'box warn', 'aria-label': W.recover.planTitle },
    el('h2', {}, W.recover.planTitle),
    el('p', { class: 'plan large' }, printer.plan), el('p', {}, plate ? W.recover.plateClearTells : W.recover.clearTells),
    may('print') && el('div', { class: 'row' },
      button(plate ? W.recover.plateClear : W.recover.clear, () => printerAction(printer.id, 'confirm'), { kind: 'main', key: 'confirm' }),
      button(W.recover.stop, () => printerAction(printer.id, 'cancel'), { key: 'refuse' })));
}
