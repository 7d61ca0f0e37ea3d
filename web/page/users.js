// Users: the list, adding, a new password, deleting.
//
// Takes: nothing. Gives: the panel for administrators.
// Does not know: what roles may do; the daemon holds that.

import { el, field, section } from './dom.js';
import { W } from './words.js';
import { get, post, put, remove, session } from './api.js';
import { asking, button, form } from './actions.js';
import { tell } from './notice.js';
import { lockedList } from './locked.js';

const ROLES = ['viewer', 'operator', 'admin'];

function passwordForm(name, done) {
  const password = el('input', { type: 'password', autocomplete: 'new-password', required: true });
  return form([field(W.settings.newPassword(name), password)], W.settings.save, async () => {
    await put(`/users/${encodeURIComponent(name)}/password`, { password: password.value });
    tell(W.settings.changed(name));
    done();
  });
}

function user({ name, role }, reload) {
  const below = el('div', {});
  const open = button(W.settings.setPassword, () => {
    below.replaceChildren(passwordForm(name, () => { below.replaceChildren(); open.focus(); }));
    below.querySelector('input').focus();
  }, { 'aria-label': `${W.settings.setPassword}: ${name}`, kind: 'small' });
  return el('li', {},
    el('div', { class: 'between' },
      el('span', {}, el('strong', {}, name), ' ', el('span', { class: 'faint' }, W.settings.roleShort[role] ?? role, name === session.user?.name && ` (${W.settings.you})`)),
      el('span', { class: 'row' }, open, name !== session.user?.name && asking(W.settings.removeUser, { question: W.settings.removeUserAsk(name), yes: W.settings.removeUserYes }, async () => {
        await remove(`/users/${encodeURIComponent(name)}`);
        tell(W.settings.removedUser(name));
        await reload();
      }))),
    below);
}

function adding(reload) {
  const name = el('input', { autocomplete: 'off', required: true, autocapitalize: 'none', spellcheck: 'false' });
  const password = el('input', { type: 'password', autocomplete: 'new-password', required: true });
  const role = el('select', {}, ROLES.map((one) => el('option', { value: one }, W.settings.roles[one])));
  return el('details', {}, el('summary', {}, W.settings.addUser),
    form([field(W.settings.name, name), field(W.settings.password, password), field(W.settings.role, role)], W.settings.addUser, async () => {
      await post('/users', { name: name.value.trim(), password: password.value, role: role.value });
      tell(W.settings.added(name.value.trim()));
      await reload();
    }));
}

export function usersPanel() {
  return section(W.settings.users, {}, lockedList(W.settings.users, () => get('/users'), (list, reload) => [
    el('ul', { class: 'rows' }, list.map((one) => user(one, reload))), adding(reload),
  ]));
}
