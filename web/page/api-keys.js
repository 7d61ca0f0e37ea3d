// Keys for programs: the list, making one (shown once), deleting.
//
// Takes: nothing. Gives: the panel for administrators.
// Does not know: who uses them.

import { el, field, section, tick } from './dom.js';
import { W } from './words.js';
import { get, post, remove } from './api.js';
import { asking, button, form } from './actions.js';
import { say, tell } from './notice.js';
import { lockedList } from './locked.js';
import { when } from './format.js';

const SCOPES = ['read', 'print', 'control', 'admin'];

/** The clipboard is there over HTTPS only; over plain HTTP the older way, and if that fails the key is at least marked. */
async function copy(input) {
  try {
    await navigator.clipboard.writeText(input.value);
    return true;
  } catch {
    input.focus();
    input.select();
    return document.execCommand('copy');
  }
}

function once(key, done) {
  const input = el('input', { class: 'mono', readonly: true, value: key, 'aria-label': W.settings.keyOnce });
  const said = el('span', { role: 'status' });
  const box = el('div', { class: 'box good' }, el('h3', {}, W.settings.keyOnce), el('p', {}, W.settings.keyOnceTells), input,
    el('div', { class: 'row' },
      button(W.settings.copy, async () => { said.textContent = await copy(input) ? W.settings.copied : W.settings.copyFailed; }, { kind: 'main' }),
      button(W.settings.keyDone, done), said));
  say(W.settings.keyOnce);
  return box;
}

function key(one, reload) {
  const about = [(one.scopes ?? []).map((scope) => W.settings.scopes[scope] ?? scope).join(', '),
    one.created_unix_s && W.settings.created(when(one.created_unix_s)), one.used_unix_s && W.settings.used(when(one.used_unix_s))].filter(Boolean).join(' · ');
  return el('li', { class: 'between' }, el('span', {}, el('strong', {}, one.name), ' ', el('span', { class: 'faint' }, about)),
    asking(W.settings.removeKey, { question: W.settings.removeKeyAsk(one.name), yes: W.settings.removeKeyYes }, async () => {
      await remove(`/keys/${encodeURIComponent(one.id)}`);
      tell(W.settings.removedKey);
      await reload();
    }));
}

function making(reload, shown) {
  const name = el('input', { autocomplete: 'off', required: true });
  const scopes = SCOPES.map((scope) => tick(`${W.settings.scopes[scope]} (${W.settings.scopeHints[scope]})`, { value: scope, checked: scope === 'read' || scope === 'print' }));
  return el('details', {}, el('summary', {}, W.settings.addKey), form([
    field(W.settings.keyName, name), el('fieldset', { class: 'stack' }, el('legend', {}, W.settings.keyScopes), scopes),
  ], W.settings.makeKey, async () => {
    const chosen = scopes.map((box) => box.querySelector('input')).filter((box) => box.checked).map((box) => box.value);
    if (!chosen.length) throw new Error(W.settings.noScope);
    const made = await post('/keys', { name: name.value.trim(), scopes: chosen });
    await reload();
    shown.replaceChildren(once(typeof made === 'string' ? made : made.key, () => shown.replaceChildren()));
    shown.querySelector('input').focus();
  }));
}

export function keysPanel() {
  const shown = el('div', {});
  return section(W.settings.keys, {}, el('p', { class: 'faint' }, W.settings.keysTells), shown, lockedList(W.settings.keys, () => get('/keys'), (list, reload) => [
    list.length ? el('ul', { class: 'rows' }, list.map((one) => key(one, reload))) : el('p', { class: 'faint' }, W.settings.noKeys), making(reload, shown),
  ]));
}
