// The emergency stop.
//
// Takes: the store (which printer is looked at, which are busy). Gives: buttons for the top bar, one click each, that
// no dialog covers. A stop that does not arrive is sent again, and told loudly if it never does.
// Does not know: the rest of the page.

import { el } from './dom.js';
import { W } from './words.js';
import { may, printerAction } from './api.js';
import { fail, tell } from './notice.js';

const TRIES = 4;
// More buttons than these would be read, not pressed.
const MOST_BUTTONS = 2;

async function stop(printers) {
  const results = await Promise.allSettled(printers.map(async ({ id }) => {
    for (let attempt = 1; ; attempt += 1) {
      try {
        return await printerAction(id, 'stop');
      } catch (error) {
        if (attempt >= TRIES || (error.status >= 400 && error.status < 500)) throw error;
      }
    }
  }));
  results.forEach((result, k) => {
    if (result.status === 'fulfilled') tell(W.stop.sent(printers[k].name));
    else fail(Object.assign(result.reason, { title: W.stop.failed(printers[k].name) }));
  });
}

function stopButton(printers, short) {
  const word = el('span', { class: 'word' }, W.stop.label);
  const made = el('button', { type: 'button', class: 'estop', title: W.stop.tip, data: { key: `stop ${short}` } },
    word, ' ', el('span', { class: 'whom' }, short));
  // A click while another is on its way sends again: a person who presses twice means it.
  made.addEventListener('click', async () => {
    word.textContent = W.stop.sending;
    await stop(printers);
    word.textContent = W.stop.label;
  });
  return made;
}

/** The part of the bar that holds the buttons: for the printer in view, and each that is busy. */
export function stopButtons(scope) {
  const { store } = scope;
  const targets = () => {
    if (!may('print')) return [];
    return [...store.printers.values()]
      .filter(({ id, state }) => id === store.selected || state === 'busy')
      .sort((a, b) => (b.id === store.selected) - (a.id === store.selected))
      .map(({ id, name }) => ({ id, name }));
  };
  return scope.part(targets, (printers) => {
    if (printers.length <= MOST_BUTTONS) return printers.map((printer) => stopButton([printer], printer.name));
    const first = printers[0].id === store.selected ? [stopButton([printers[0]], printers[0].name)] : [];
    return [...first, stopButton(printers, W.stop.allShort(printers.length))];
  }, { class: 'estops', role: 'group', 'aria-label': W.stop.group });
}
