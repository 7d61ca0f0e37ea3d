// Files on their way to the daemon: dropped anywhere on the page, or chosen.
//
// Takes: files, the printer in view (or asks for which). Gives: a panel with a bar for each file; sent one after the
// other, since two at once would only share the same network.
// Does not know: what is in the files; the daemon says what it cannot take.

import { el, field, tick } from './dom.js';
import { W } from './words.js';
import { may, post, readSession, sendFile } from './api.js';
import { dialog } from './dialog.js';
import { button } from './actions.js';
import { bar } from './progress.js';
import { percent } from './format.js';
import { say } from './notice.js';
import { store } from './live.js';

/** Whether what is sent from the printer's view is held; the box for it is there. */
export const wish = { hold: false };

// What arrived is told for so long; it is in the queue or among the files then.
const DONE_MS = 12_000;

const list = el('ul', {});
let panel = null;
let before = Promise.resolve();

/** For which printer, and whether to print: known in a printer's view, else asked. */
async function target() {
  const all = [...store.printers.values()];
  if (store.selected && store.printers.has(store.selected)) return { printer: store.selected, queue: true, hold: wish.hold };
  if (!all.length) return { printer: null, queue: false, hold: false };
  return dialog(W.upload.to, (close) => {
    const printer = el('select', {}, all.map(({ id, name }) => el('option', { value: id }, name)));
    const queue = tick(W.upload.queue, { checked: !location.hash.startsWith('#/files') });
    const hold = tick(W.queue.hold, { checked: wish.hold });
    const on = (box) => box.querySelector('input').checked;
    return el('div', { class: 'stack' }, field(W.upload.printer, printer), queue, hold,
      button(W.upload.go, () => close({ printer: printer.value, queue: on(queue), hold: on(hold) }), { kind: 'main' }));
  });
}

async function sendOne(file, { printer, queue, hold }, row) {
  await before;
  if (row.gone.signal.aborted) return;
  row.state(W.upload.sent(percent(0)));
  const send = () => sendFile(file, printer, (fraction) => {
    row.set(fraction ?? NaN);
    row.state(W.upload.sent(percent(fraction)));
  }, row.gone.signal);
  const taken = await send().catch(async (error) => {
    if (error.kind !== 'csrf') throw error;
    await readSession();
    return send();
  });
  row.set(1);
  row.state(W.upload.checking);
  if (!queue || !printer) return row.done(printer ? W.upload.stored : W.upload.noPrinter, '#/files', W.shell.files);
  const job = await post('/jobs', { file: taken.id, printer, hold });
  return row.done(W.upload.queued(store.printers.get(printer)?.name ?? printer), `#/job/${encodeURIComponent(job.id)}`, W.upload.see);
}

/** A line of the panel for one file. */
function line(file) {
  const { made, set } = bar(W.upload.file(file.name));
  const words = el('p', { class: 'faint' }, W.upload.waiting);
  const gone = new AbortController();
  const end = el('span', { class: 'row' }, button(W.upload.stop, () => gone.abort(), { kind: 'small', 'aria-label': `${W.upload.stop}: ${file.name}` }));
  const item = el('li', {}, el('p', { class: 'clip' }, file.name), made, el('div', { class: 'between' }, words, end));
  const leave = () => {
    item.remove();
    panel.hidden = !list.children.length;
  };
  const close = () => button(W.upload.close, leave, { kind: 'small', 'aria-label': `${W.upload.close}: ${file.name}` });
  list.append(item);
  panel.hidden = false;
  gone.signal.addEventListener('abort', () => {
    words.textContent = W.upload.givenUp;
    end.replaceChildren(close());
  });
  return {
    set, gone,
    state: (text) => { words.textContent = text; },
    done(text, href, link) {
      words.textContent = text;
      say(`${file.name}: ${text}`);
      // Whoever goes to see it has seen that it arrived.
      end.replaceChildren(el('a', { href, on: { click: leave } }, link), close());
      setTimeout(() => { if (!item.contains(document.activeElement)) leave(); }, DONE_MS);
    },
    failed(error) {
      item.classList.add('bad');
      words.textContent = `${error.title ?? W.upload.failed}: ${error.message}`;
      say(`${file.name}: ${words.textContent}`);
      end.replaceChildren(close());
    },
  };
}

export async function sendFiles(files) {
  const chosen = [...files];
  if (!chosen.length || !may('print')) return;
  const to = await target();
  if (!to) return;
  for (const file of chosen) {
    const row = line(file);
    before = sendOne(file, to, row).catch((error) => { if (!row.gone.signal.aborted) row.failed(error); });
  }
}

/** The browser's own choice of files. */
export function chooseFiles() {
  const input = el('input', { type: 'file', multiple: true });
  input.addEventListener('change', () => sendFiles(input.files));
  input.click();
}

export function uploadPanel(scope) {
  const id = 'uploads-title';
  panel = el('section', { class: 'uploads', 'aria-labelledby': id, hidden: !list.children.length, data: { coverable: '' } }, el('h2', { id }, W.upload.title), list);
  scope.ends.push(() => panel.remove());
  return panel;
}

/** The whole page takes files. Drags of other things, as of the queue, are left alone. */
export function dropUploads(scope) {
  const words = el('p', {});
  const over = el('div', { class: 'drop', hidden: true, 'aria-hidden': 'true' }, words);
  document.body.append(over);
  scope.ends.push(() => over.remove());
  let depth = 0;
  const ours = (event) => may('print') && event.dataTransfer?.types.includes('Files');
  const show = (shown) => { over.hidden = !shown; };
  scope.on(window, 'dragenter', (event) => {
    if (!ours(event)) return;
    depth += 1;
    const name = store.printers.get(store.selected)?.name;
    words.textContent = name ? W.upload.dropOn(name) : W.upload.drop;
    show(true);
  });
  scope.on(window, 'dragleave', (event) => { if (ours(event) && --depth <= 0) show(false); });
  scope.on(window, 'dragover', (event) => { if (ours(event)) event.preventDefault(); });
  scope.on(window, 'drop', (event) => {
    if (!ours(event)) return;
    event.preventDefault();
    depth = 0;
    show(false);
    sendFiles(event.dataTransfer.files);
  });
}
