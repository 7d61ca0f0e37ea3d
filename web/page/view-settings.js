// Settings: who am I, this page, and for administrators users, keys and those who ask for one.
//
// Takes: the session. Gives: the view. Users and keys are modules of their own.
// Does not know: printers.

import { el, section, terms } from './dom.js';
import { W } from './words.js';
import { logOut, may, session } from './api.js';
import { store } from './live.js';
import { button } from './actions.js';
import { lettersSwitch } from './keys.js';
import { keyRequest } from './shell.js';
import { toggleTheme } from './theme.js';
import { usersPanel } from './users.js';
import { keysPanel } from './api-keys.js';

export const title = () => W.settings.title;

function me() {
  return section(W.settings.me, {},
    terms([W.settings.name, session.user.name], [W.settings.role, W.settings.roles[session.user.role] ?? session.user.role],
      [W.settings.may, session.user.scopes.map((scope) => W.settings.scopes[scope] ?? scope).join(', ')], [W.settings.version, session.version]),
    el('div', { class: 'row' }, button(W.settings.logOut, async () => {
      await logOut();
      dispatchEvent(new Event('outrigger-session'));
    })));
}

export function view(scope) {
  return [
    el('h1', { tabindex: -1 }, W.settings.title),
    el('div', { class: 'columns even' },
      el('div', {}, me(), section(W.settings.page, {}, el('div', { class: 'row' }, button(W.shell.theme, toggleTheme)), lettersSwitch())),
      may('admin') && el('div', {},
        section(W.settings.requests, {}, scope.part(() => [...store.requests.values()], (list) => (list.length
          ? list.map((one) => keyRequest(scope, one)) : el('p', { class: 'faint' }, W.settings.noRequests)))),
        usersPanel(), keysPanel())),
  ];
}
