// Pause, resume, cancel, connect.
//
// Takes: a printer's id. Gives: the buttons that make sense now, by what its job says it can.
// Does not know: the emergency stop, which stands in the bar.

import { el } from './dom.js';
import { W } from './words.js';
import { jobAction, may, printerAction } from './api.js';
import { store } from './live.js';
import { asking, button } from './actions.js';
import { sentence } from './format.js';

/** Why a panel is of no use now, in words, or null. `busy` says what to tell while a job has the printer. */
export function blocked(printer, busy = W.blocked.busy) {
  if (!may('control')) return W.blocked.scope;
  if (!printer || printer.state === 'offline' || printer.state === 'connecting') return W.blocked.offline;
  if (printer.state === 'failed') return W.blocked.failed;
  return printer.state === 'busy' ? busy : null;
}

/** A fieldset that is switched off with the reason above it, and on again. */
export function guarded(scope, id, legend, ...children) {
  const why = el('p', { class: 'reason', id: `why-${legend}-${id}`.replace(/\W+/g, '-') });
  const set = el('fieldset', { 'aria-describedby': why.id }, el('legend', { class: 'unseen' }, legend), ...children);
  scope.watch(() => blocked(store.printers.get(id)), (reason) => {
    why.textContent = reason ?? '';
    why.hidden = !reason;
    set.disabled = Boolean(reason);
  });
  return [why, set];
}

export function controls(scope, id) {
  const printer = () => store.printers.get(id) ?? {};
  const what = () => {
    const job = store.jobs.get(printer().job);
    return { state: printer().state, job: job?.id ?? null, jobState: job?.state, can: job?.can ?? [], plan: Boolean(printer().plan), error: printer().error };
  };
  return scope.part(what, ({ state, job, can, plan, error }) => {
    if (!may('print')) return el('p', { class: 'reason' }, W.printer.noPrint);
    const act = (action) => () => printerAction(id, action);
    const idle = state === 'ready';
    return [
      (state === 'offline' || (state === 'connecting' && error)) && el('p', { class: 'reason' }, sentence(error) || W.printer.offlineTells),
      state === 'failed' && el('div', { class: 'box bad' }, error && el('p', {}, sentence(error)), el('p', {}, W.printer.failedTells)),
      el('div', { class: 'row' },
        can.includes('pause') && button(W.printer.pause, act('pause'), { kind: 'main', key: 'pause' }),
        // While a plan waits for its yes, that panel has the buttons.
        !plan && can.includes('resume') && button(W.printer.resume, act('resume'), { kind: 'main', key: 'pause' }),
        !plan && can.includes('cancel') && asking(W.printer.cancel, { question: W.printer.cancelAsk, yes: W.printer.cancelYes, key: 'cancel' },
          () => (job ? jobAction(job, 'cancel') : printerAction(id, 'cancel'))),
        (state === 'offline' || state === 'failed') && button(W.printer.connect, act('connect'), { kind: 'main', key: 'connect' }),
        idle && button(W.printer.disconnect, act('disconnect'), { key: 'connect' })),
    ];
  }, { class: 'controls' });
}
