// All files: size, date, what the check said for each printer, printing, deleting.
//
// Takes: the store. Gives: the view.
// Does not know: what becomes of a job that is made here.

import { el, field } from './dom.js';
import { W } from './words.js';
import { may, post, remove } from './api.js';
import { store } from './live.js';
import { asking, button } from './actions.js';
import { tell } from './notice.js';
import { bytes, when } from './format.js';
import { checkPill, countsOf } from './check.js';
import { chooseFiles } from './upload.js';

export const title = () => W.files.title;

function checksOf(file) {
  const list = Object.entries(file.checks ?? {});
  if (!list.length) return el('p', { class: 'faint' }, W.check.none);
  return el('ul', { class: 'checks' }, list.map(([printer, check]) => el('li', {},
    el('span', { class: 'faint' }, W.files.checkOn(store.printers.get(printer)?.name ?? printer)), checkPill(check),
    check.state === 'found' && el('span', {}, countsOf(check)), check.state === 'failed' && el('span', {}, check.words),
    check.picture?.startsWith('/api/v2/') && el('a', { href: check.picture, target: '_blank', rel: 'noopener', 'aria-label': `${W.files.picture}: ${file.name}, ${store.printers.get(printer)?.name ?? printer}` }, W.files.picture))));
}

function printOn(file) {
  const printers = [...store.printers.values()];
  if (!printers.length || !may('print')) return null;
  const choice = el('select', { 'aria-label': `${W.files.printOn}: ${file.name}`, data: { key: `on ${file.id}` } }, printers.map(({ id, name }) => el('option', { value: id }, name)));
  const print = async () => {
    const job = await post('/jobs', { file: file.id, printer: choice.value, hold: false });
    tell(W.files.queued(file.name, store.printers.get(choice.value)?.name ?? choice.value));
    location.hash = `#/job/${encodeURIComponent(job.id)}`;
  };
  // Its name begins with what is seen on it, so that who says what is seen presses it.
  const words = printers.length > 1 ? W.files.print : `${W.files.printOn} ${printers[0].name}`;
  return [printers.length > 1 ? choice : null, button(words, print, { kind: 'main', 'aria-label': `${words}: ${file.name}`, key: `print ${file.id}` })];
}

function row(scope, id) {
  const file = () => store.files.get(id);
  return el('li', { class: 'panel file' },
    el('div', { class: 'file-what' },
      el('h2', { class: 'clip' }, file().name),
      el('p', { class: 'faint' }, [bytes(file().bytes), W.files.kind[file().kind] ?? file().kind, when(file().uploaded_unix_s), file().by && W.files.by(file().by)].filter(Boolean).join(' · ')),
      scope.part(() => [file()?.checks, [...store.printers.values()].map(({ id: printer, name }) => [printer, name])], () => (file() ? checksOf(file()) : []))),
    el('div', { class: 'row', role: 'group', 'aria-label': W.files.actions(file().name) },
      scope.part(() => [...store.printers.values()].map(({ id: printer, name }) => [printer, name]), () => (file() ? printOn(file()) : []), { class: 'row' }),
      el('a', { class: 'button', href: `/api/v2/files/${encodeURIComponent(id)}/content`, download: file().name, 'aria-label': `${W.files.download}: ${file().name}` }, W.files.download),
      may('print') && asking(W.files.remove, { question: W.files.removeAsk(file().name), yes: W.files.removeYes, key: `remove ${id}` }, async () => {
        const { name } = file();
        await remove(`/files/${encodeURIComponent(id)}`);
        tell(W.files.removed(name));
      })));
}

export function view(scope) {
  const search = el('input', { type: 'search', autocomplete: 'off' });
  const count = el('p', { class: 'faint', role: 'status' });
  let sought = '';
  search.addEventListener('input', () => {
    sought = search.value.trim().toLowerCase();
    store.changed();
  });
  const ids = () => [...store.files.values()].filter(({ name }) => name.toLowerCase().includes(sought)).sort((a, b) => b.uploaded_unix_s - a.uploaded_unix_s).map(({ id }) => id);
  scope.watch(() => ids().length, (n) => { count.textContent = W.files.count(n); });
  return [
    el('div', { class: 'view-head' }, el('h1', { tabindex: -1 }, W.files.title), count, el('span', { class: 'grow' }), may('print') && button(W.files.choose, chooseFiles, { kind: 'main' })),
    el('div', { class: 'find' }, field(W.files.search, search)),
    scope.part(ids, (list, inner) => (list.length
      ? el('ul', { class: 'files' }, list.map((id) => row(inner, id)))
      : el('p', { class: 'empty' }, store.files.size ? W.files.noMatch : may('print') ? W.files.noneSend : W.files.none))),
  ];
}
