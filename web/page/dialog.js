// Dialogs that leave the emergency stop alone.
//
// Takes: a title and what stands in the dialog. Gives: a promise of what it was closed with.
// A modal dialog of the browser would lie above the bar with the emergency stop and make it deaf. This one covers only what is
// below the bar; that is made inert, so that the keys go round between the dialog and the bar.
// Does not know: what is asked.

import { el, field } from './dom.js';
import { form, button } from './actions.js';
import { W } from './words.js';
import { post } from './api.js';

let open = null;

/** Opens a dialog. `fill` gets a function that closes it with a value, and gives the children. */
export function dialog(title, fill, cls = '') {
  open?.close(null);
  return new Promise((done) => {
    const before = document.activeElement;
    const covered = [...document.querySelectorAll('[data-coverable]')];
    const close = (value) => {
      if (open !== mine) return;
      open = null;
      veil.remove();
      removeEventListener('keydown', escape, true);
      for (const part of covered) part.inert = false;
      if (before?.isConnected) before.focus();
      done(value);
    };
    const escape = (event) => {
      if (event.key !== 'Escape') return;
      event.stopPropagation();
      close(null);
    };
    const mine = { close };
    const heading = el('h2', { id: 'dialog-title', tabindex: -1 }, title);
    const box = el('div', { class: `dialog ${cls}`, role: 'dialog', 'aria-labelledby': 'dialog-title' },
      el('div', { class: 'head' }, heading, button('×', () => close(null), { kind: 'quiet icon', 'aria-label': W.dialog.close })),
      fill(close));
    const veil = el('div', { class: 'veil', on: { pointerdown: (event) => { if (event.target === veil) close(null); } } }, box);
    open = mine;
    for (const part of covered) part.inert = true;
    document.body.append(veil);
    addEventListener('keydown', escape, true);
    (box.querySelector('input, select, textarea') ?? heading).focus();
  });
}

export const dialogOpen = () => open !== null;

let asked = null;

/** Asks for the password again, once however many wait for it. Gives whether it was right. */
export function askPassword() {
  asked ??= dialog(W.again.title, (close) => {
    const password = el('input', { type: 'password', name: 'password', autocomplete: 'current-password', required: true });
    return [
      el('p', {}, W.again.why),
      form([field(W.login.password, password)], W.again.submit, async () => {
        await post('/session/confirm', { password: password.value });
        close(true);
      }),
    ];
  }).then((value) => {
    asked = null;
    return value === true;
  });
  return asked;
}
