// A list that the daemon shows only to those who just gave their password.
//
// Takes: how to fetch it and how to draw it. Gives: the list, fetched when it is asked for, so that the settings do not
// begin with a password.
// Does not know: what is listed.

import { el } from './dom.js';
import { W } from './words.js';
import { button } from './actions.js';

export function lockedList(title, fetchList, drawList) {
  const place = el('div', { class: 'part' });
  const load = async () => {
    const focused = place.contains(document.activeElement);
    const list = await fetchList();
    place.replaceChildren(...[drawList(list, load)].flat(9).filter(Boolean));
    if (!focused) return;
    place.tabIndex = -1;
    place.focus();
  };
  const show = () => place.replaceChildren(el('p', { class: 'faint' }, W.settings.locked), el('div', { class: 'row' }, button(W.settings.show, load, { 'aria-label': `${W.settings.show}: ${title}` })));
  show();
  return place;
}
