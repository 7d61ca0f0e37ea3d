// Log in, and the very first account.
//
// Takes: what to do afterwards, and why it is shown (or nothing). Gives: the view.
// Does not know: sessions beyond the calls that make one.

import { el, field } from './dom.js';
import { W } from './words.js';
import { form } from './actions.js';
import { logIn, session, setUp } from './api.js';

function logInForm(done) {
  const name = el('input', { name: 'name', autocomplete: 'username', required: true, autocapitalize: 'none', spellcheck: 'false' });
  const password = el('input', { type: 'password', name: 'password', autocomplete: 'current-password', required: true });
  return form([field(W.login.name, name), field(W.login.password, password)], W.login.submit, async () => {
    await logIn(name.value.trim(), password.value);
    done();
  });
}

function setUpForm(done) {
  const code = el('input', { name: 'code', autocomplete: 'one-time-code', required: true, autocapitalize: 'none', spellcheck: 'false' });
  const name = el('input', { name: 'name', autocomplete: 'username', required: true, autocapitalize: 'none', spellcheck: 'false' });
  const password = el('input', { type: 'password', name: 'password', autocomplete: 'new-password', required: true });
  return form([
    field(W.setup.code, code, W.setup.codeHint), field(W.setup.name, name), field(W.setup.password, password, W.setup.passwordHint),
  ], W.setup.submit, async () => {
    await setUp(code.value.trim(), name.value.trim(), password.value);
    done();
  });
}

export function logInView(done, words) {
  const first = session.needs_first_user;
  return el('main', { class: 'login' },
    el('div', { class: 'login-head' }, el('img', { src: '/assets/icon.svg', alt: '', width: 44, height: 44 }), el('p', { class: 'wordmark' }, W.name), el('p', { class: 'faint' }, W.login.aside)),
    el('div', { class: 'panel' },
      el('h1', {}, first ? W.setup.title : W.login.title),
      first && el('p', {}, W.setup.tells),
      words && el('p', { class: 'box warn', role: 'status' }, words),
      first ? setUpForm(done) : logInForm(done)));
}
