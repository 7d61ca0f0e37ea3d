// Begins: who is asking, the shell, the routes.
//
// Takes: the address behind `#`, the session. Gives: one view at a time in the shell, or the log-in.
// Does not know: what views hold.

import { el } from './dom.js';
import { W } from './words.js';
import { Scope } from './scope.js';
import { get, hooks, may, printerAction, readSession, session } from './api.js';
import { Live, store } from './live.js';
import { applyTheme, toggleTheme } from './theme.js';
import { fail, noticeElements } from './notice.js';
import { askPassword } from './dialog.js';
import { onKeys, showKeys } from './keys.js';
import { shell } from './shell.js';
import { dropUploads, chooseFiles, uploadPanel } from './upload.js';
import * as printers from './view-printers.js';

// Views beyond the first are fetched when they are gone to.
const ROUTES = [
  [/^#?\/?$/, () => printers],
  [/^#\/printer\/([^/]+)$/, () => import('./view-printer.js')],
  [/^#\/job\/([^/]+)$/, () => import('./view-job.js')],
  [/^#\/files$/, () => import('./view-files.js')],
  [/^#\/settings$/, () => import('./view-settings.js')],
];

let live = null;
let frame = null;
let frameScope = null;
let viewScope = null;
let shown = 0;

function missing() {
  return el('div', { class: 'empty' }, el('h1', { tabindex: -1 }, W.shell.missing), el('p', {}, W.shell.missingTells), el('a', { href: '#/' }, W.shell.back));
}

/** Puts the view of the address in its place. The heading gets the focus, so that it is read, but not at the very first. */
async function route({ first = false } = {}) {
  if (!frame || !session.user) return;
  const mine = ++shown;
  const hash = location.hash || '#/';
  const found = ROUTES.map(([pattern, load]) => ({ match: pattern.exec(hash), load })).find(({ match }) => match);
  const view = await Promise.resolve(found?.load()).catch(() => fail({ status: 0, title: W.problem.internal, message: W.problem.loadFailed }));
  // A page that was left while its module was on its way is not shown any more.
  if (mine !== shown) return;
  viewScope?.dispose();
  viewScope = new Scope(store);
  store.selected = null;
  frame.mark(hash);
  const id = found?.match[1] ? decodeURIComponent(found.match[1]) : null;
  const scope = viewScope;
  const place = scope.part(() => [store.told, store.told && view?.known ? view.known(id) : true], ([told, known], inner) => {
    if (!told) return el('p', { class: 'empty', role: 'status' }, W.shell.loading);
    if (!view || !known) return missing();
    store.selected = view.selects?.(id) ?? null;
    store.changed();
    return view.view(inner, id);
  });
  frame.main.replaceChildren(place);
  const title = () => (view?.title ? view.title(id) : W.shell.missing);
  scope.watch(title, (words) => { document.title = `${words} · ${W.name}`; });
  store.changed();
  if (!first) {
    scrollTo(0, 0);
    (frame.main.querySelector('h1') ?? frame.main).focus({ preventScroll: true });
  }
}

/** All anew for whoever asks now. */
async function begin(words = null) {
  live?.end();
  live = null;
  viewScope?.dispose();
  frameScope?.dispose();
  store.clear();
  frameScope = new Scope(store);
  frame = null;
  document.documentElement.dataset.stale = 'no';
  if (!session.user) {
    const { logInView } = await import('./view-login.js');
    document.title = `${session.needs_first_user ? W.setup.title : W.login.title} · ${W.name}`;
    document.body.replaceChildren(logInView(() => begin(), words), ...noticeElements);
    document.body.querySelector('input')?.focus();
    return;
  }
  frame = shell(frameScope, { theme: toggleTheme, help: showKeys, reconnect: () => live?.connect() });
  document.body.replaceChildren(...frame.elements, uploadPanel(frameScope), ...noticeElements);
  dropUploads(frameScope);
  live = new Live(async () => {
    await readSession();
    if (!session.user) begin(W.login.loggedOut);
  });
  if (may('admin')) {
    get('/keys/requests').then((list) => {
      for (const one of list ?? []) store.requests.set(one.id, one);
      store.changed();
    }, fail);
  }
  route({ first: true });
}

/** Pause or resume of the printer in view, by its key. */
function pauseKey() {
  const can = store.jobs.get(store.printers.get(store.selected)?.job)?.can ?? [];
  const action = ['pause', 'resume'].find((one) => can.includes(one));
  if (action && may('print')) printerAction(store.selected, action).catch(fail);
}

hooks.password = askPassword;
hooks.loggedOut = () => {
  if (!session.user) return;
  session.user = null;
  session.csrf = null;
  begin(W.login.loggedOut);
};
addEventListener('hashchange', () => route());
addEventListener('outrigger-session', () => begin());
onKeys({
  '?': showKeys, 1: () => { location.hash = '#/'; }, 2: () => { location.hash = '#/files'; }, 3: () => { location.hash = '#/settings'; },
  '!': () => document.querySelector('.estop')?.focus(), u: () => session.user && chooseFiles(), p: pauseKey, l: toggleTheme,
});

applyTheme();
readSession().then(() => begin(), (error) => {
  const again = el('button', { type: 'button', class: 'main', on: { click: () => location.reload() } }, W.connection.now);
  document.body.replaceChildren(el('main', { class: 'empty' }, el('h1', {}, error.title ?? W.problem.title), el('p', {}, error.message), again));
});
