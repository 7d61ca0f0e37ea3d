// The keys of the page, and the list of them.
//
// Takes: what each key does. Gives: listeners that leave fields alone, and the dialog that lists the keys.
// Single letters can be switched off, since speech input and shaky hands press them unmeant.
// Does not know: views.

import { el, tick } from './dom.js';
import { W } from './words.js';
import { dialog, dialogOpen } from './dialog.js';

const KEY = 'outrigger-letters';

function lettersOn() {
  try { return localStorage.getItem(KEY) !== 'off'; } catch { return true; }
}

export function onKeys(acts) {
  addEventListener('keydown', (event) => {
    const act = acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act || event.ctrlKey || event.metaKey || event.altKey || event.repeat || event.defaultPrevented) return;
    if (event.target.closest?.('input:not([type=checkbox], [type=radio]), select, textarea') || (event.key !== '!' && dialogOpen())) return;
    if (event.key !== '?' && !lettersOn()) return;
    event.preventDefault();
    act();
  });
}

const rows = (list) => el('dl', { class: 'keys' }, list.map(([key, what]) => el('div', {}, el('dt', {}, el('kbd', {}, key)), el('dd', {}, what))));

export function lettersSwitch() {
  return tick(W.keys.on, {
    checked: lettersOn(),
    on: { change: (event) => { try { localStorage.setItem(KEY, event.target.checked ? 'on' : 'off'); } catch { /* Then they stay on. */ } } },
  });
}

export function showKeys() {
  return dialog(W.keys.title, () => [rows(W.keys.list), el('h3', {}, W.keys.pad), rows(W.keys.padList), lettersSwitch()]);
}
