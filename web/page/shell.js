// What stands around every view: the bar, the navigation, the banners, the place for the view.
//
// Takes: a scope, and what to do on theme, help and upload. Gives: the elements and the `main` that views are put into.
// Does not know: the views.

import { el } from './dom.js';
import { W } from './words.js';
import { may, post, session } from './api.js';
import { button } from './actions.js';
import { stopButtons } from './stop.js';
import { say, tell } from './notice.js';
import { clock } from './format.js';

const ROUTES = [['#/', () => W.shell.printers], ['#/files', () => W.shell.files], ['#/settings', () => W.shell.settings]];

/** The lost connection: a banner, a mark on the page by which the style sheet shows that all is old, and the time. */
function connectionBanner(scope, reconnect) {
  const { store } = scope;
  let wasLost = false;
  return scope.part(() => [store.connection === 'lost', store.told], ([lost, told]) => {
    document.documentElement.dataset.stale = lost ? 'yes' : 'no';
    if (wasLost && !lost && store.connection === 'live') say(W.connection.back);
    wasLost = lost;
    if (!lost) return [];
    const words = told ? W.connection.tells(clock(new Date(store.heardMs), true)) : W.connection.never;
    return el('div', { class: 'banner bad' }, el('p', {}, el('strong', {}, W.connection.lost), ' ', words), button(W.connection.now, reconnect, { kind: 'small' }));
  }, { role: 'alert' });
}

export function keyRequest(scope, { id, app }) {
  const name = app || W.requests.noApp;
  const answer = (allow) => async () => {
    await post(`/keys/requests/${encodeURIComponent(id)}`, { allow });
    scope.store.requests.delete(id);
    scope.store.changed();
    tell(allow ? W.requests.allowed(name) : W.requests.denied(name));
  };
  return el('div', { class: 'banner warn' }, el('p', {}, W.requests.asks(name)),
    el('span', { class: 'row' }, button(W.requests.allow, answer(true), { kind: 'small main', key: `allow ${id}` }), button(W.requests.deny, answer(false), { kind: 'small', key: `deny ${id}` })));
}

function keyRequests(scope) {
  return scope.part(() => (may('admin') ? [...scope.store.requests.values()] : []), (list) => list.map((one) => keyRequest(scope, one)), { 'aria-live': 'polite' });
}

/** Says what changes to those who do not see it: states of printers and jobs, never temperatures. */
function announce(scope) {
  const { store } = scope;
  let last = null;
  scope.watch(() => [
    ...[...store.printers.values()].map((p) => [`p${p.id}`, `${p.name}: ${W.printerState[p.state] ?? p.state_words}${p.question ? `. ${W.attention.question}: ${p.question.text}` : ''}`]),
    ...[...store.jobs.values()].map((j) => [`j${j.id}`, `${j.name}: ${W.jobState[j.state]?.[0] ?? j.state_words}`]),
  ], (states) => {
    const now = new Map(states);
    if (last?.size) for (const [key, words] of now) if (last.get(key) !== words) say(words);
    last = store.told ? now : null;
  });
}

export function shell(scope, { theme, help, reconnect }) {
  const nav = el('nav', { 'aria-label': W.shell.nav, data: { coverable: '' } }, ROUTES.map(([href, words]) => el('a', { href }, words())));
  const header = el('header', {},
    el('a', { class: 'brand', href: '#/', 'aria-label': `${W.name}: ${W.shell.printers}`, data: { coverable: '' } }, el('img', { src: '/assets/icon.svg', alt: '', width: 28, height: 28 }), el('span', {}, W.name)),
    nav, stopButtons(scope),
    el('div', { class: 'tools', data: { coverable: '' } },
      button('◐', theme, { kind: 'icon quiet', 'aria-label': W.shell.theme, title: W.shell.theme }),
      button('?', help, { kind: 'icon quiet help', 'aria-label': W.shell.help, title: W.shell.help })));
  const banners = el('div', { class: 'banners', data: { coverable: '' } }, connectionBanner(scope, reconnect), keyRequests(scope));
  const main = el('main', { id: 'main', tabindex: -1, data: { coverable: '' } });
  // By script, since the address holds the route.
  const skip = el('button', { type: 'button', class: 'skip', on: { click: () => main.focus() } }, W.shell.skip);
  // Dialogs and notes begin below the bar, however high it is.
  const measured = new ResizeObserver(() => document.documentElement.style.setProperty('--bar', `${header.offsetHeight}px`));
  measured.observe(header);
  scope.ends.push(() => measured.disconnect());
  if (session.user) announce(scope);
  const mark = (hash) => {
    const head = hash.split('/')[1] ?? '';
    for (const link of nav.children) {
      const here = link.getAttribute('href') === `#/${head}` || (link.getAttribute('href') === '#/' && ['', 'printer', 'job'].includes(head));
      if (here) link.setAttribute('aria-current', 'page');
      else link.removeAttribute('aria-current');
    }
  };
  return { elements: [skip, header, banners, main], main, mark };
}
