// The queue of a printer, and how files get into it.
//
// Takes: a printer's id. Gives: its jobs in order; the order is changed by dragging, or by buttons that any key reaches.
// Does not know: how a job is printed or decided.

import { el, section, tick } from './dom.js';
import { W } from './words.js';
import { jobAction, may, put } from './api.js';
import { store } from './live.js';
import { asking, button } from './actions.js';
import { jobPill } from './progress.js';
import { chooseFiles, wish } from './upload.js';
import { fail, say } from './notice.js';

const nameOf = (job) => store.jobs.get(job)?.name ?? W.queue.unknown;

/** Tells the daemon the new order, and the screen reader the new place. */
async function reorder(id, queue, from, to) {
  if (to < 0 || to >= queue.length || from === to) return;
  const order = [...queue];
  order.splice(to, 0, ...order.splice(from, 1));
  await put(`/printers/${encodeURIComponent(id)}/queue`, { order });
  say(W.queue.moved(nameOf(queue[from]), to + 1, queue.length));
}

/** Dragging within the list. What is dragged is this list's own, so that files from outside are not meant. */
function draggable(item, id, queue, place, dragged) {
  item.draggable = true;
  item.addEventListener('dragstart', (event) => {
    dragged.from = place;
    event.dataTransfer.effectAllowed = 'move';
    event.dataTransfer.setData('text/plain', nameOf(queue[place]));
    item.classList.add('dragged');
  });
  item.addEventListener('dragend', () => {
    dragged.from = null;
    item.classList.remove('dragged');
  });
  item.addEventListener('dragover', (event) => {
    if (dragged.from === null || dragged.from === undefined) return;
    event.preventDefault();
    item.classList.toggle('over', dragged.from !== place);
  });
  item.addEventListener('dragleave', () => item.classList.remove('over'));
  item.addEventListener('drop', (event) => {
    item.classList.remove('over');
    if (dragged.from === null || dragged.from === undefined) return;
    event.preventDefault();
    reorder(id, queue, dragged.from, place).catch(fail);
  });
}

function row(id, queue, place, dragged) {
  const job = store.jobs.get(queue[place]) ?? { id: queue[place], name: W.queue.unknown, state: 'queued', can: [] };
  const step = (by) => () => reorder(id, queue, place, place + by);
  const item = el('li', { class: 'queued' },
    may('print') && el('span', { class: 'grip', 'aria-hidden': 'true', title: W.queue.drag }, '⠿'),
    el('span', { class: 'place' }, String(place + 1)),
    el('a', { class: 'clip', href: `#/job/${encodeURIComponent(job.id)}`, draggable: 'false', data: { key: job.id } }, job.name),
    jobPill(job),
    // The ends are told as disabled and yet keep the focus: whoever moved a job to the top may want to move it back.
    may('print') && el('span', { class: 'row tight' },
      button('↑', step(-1), { kind: 'icon quiet', 'aria-label': W.queue.up(job.name), 'aria-disabled': place === 0 ? 'true' : null, key: `up ${job.id}` }),
      button('↓', step(1), { kind: 'icon quiet', 'aria-label': W.queue.down(job.name), 'aria-disabled': place === queue.length - 1 ? 'true' : null, key: `down ${job.id}` }),
      job.can.includes('cancel') && asking(W.queue.take, { question: W.queue.takeAsk(job.name), yes: W.queue.takeYes, key: `take ${job.id}` }, () => jobAction(job.id, 'cancel'))));
  if (may('print')) draggable(item, id, queue, place, dragged);
  return item;
}

export function queuePanel(scope, id) {
  const dragged = { from: null };
  const printer = () => store.printers.get(id);
  const what = () => (printer()?.queue ?? []).map((job) => {
    const { name, state, can } = store.jobs.get(job) ?? {};
    return { job, name, state, can };
  });
  const rows = scope.part(what, (jobs) => {
    const queue = jobs.map(({ job }) => job);
    return queue.length ? el('ol', { class: 'rows' }, queue.map((_, place) => row(id, queue, place, dragged))) : el('p', { class: 'faint' }, may('print') ? W.queue.noneSend : W.queue.none);
  });
  const hold = tick(W.queue.hold, { checked: wish.hold, on: { change: (event) => { wish.hold = event.target.checked; } } });
  return section(W.queue.title, {}, rows,
    may('print') && el('div', { class: 'between' }, button(W.queue.choose, chooseFiles, { kind: 'main', key: 'choose' }), hold),
    scope.text(() => W.printer.onFindings[printer()?.on_findings] ?? '', 'p', { class: 'faint' }));
}
