// What the page says: to screen readers what changes, to all what was done and what failed.
//
// Takes: words, or a Problem. Gives: a live region that is read aloud, and notes that stand until they are dismissed
// (failures) or for a while (what was done).
// Does not know: what the words are about.

import { el } from './dom.js';
import { W } from './words.js';

const DONE_MS = 6000;

const spoken = el('div', { class: 'unseen', role: 'status', 'aria-live': 'polite' });
const notes = el('div', { class: 'toasts', role: 'region', 'aria-label': W.notice.region });

export const noticeElements = [spoken, notes];

/** Said to screen readers only. A line of its own each time, since a text that stays the same is not read again. */
export function say(words) {
  const line = el('p', {}, words);
  spoken.append(line);
  setTimeout(() => line.remove(), 5000);
}

function note(kind, title, words) {
  const made = el('div', { class: `toast ${kind}`, role: kind === 'bad' ? 'alert' : 'status' });
  const close = el('button', { type: 'button', class: 'quiet icon', 'aria-label': W.notice.dismiss, on: { click: () => made.remove() } }, '×');
  notes.append(made);
  // The region must be there before its words, or they are not read.
  made.append(el('div', {}, title && el('strong', {}, title), words && el('p', {}, words)), close);
  return made;
}

/** Tells that something was done. */
export function tell(words) {
  const made = note('good', null, words);
  setTimeout(() => { if (!made.contains(document.activeElement)) made.remove(); }, DONE_MS);
}

/** Tells what failed. The same failure is told once at a time. */
export function fail(error) {
  const title = error.title ?? W.problem.title;
  const again = error.retryAfter ? ` ${W.problem.retryAfter(error.retryAfter)}` : '';
  const words = (error.message === title ? '' : error.message) + again;
  for (const other of notes.querySelectorAll('.bad')) if (other.dataset.words === title + words) other.remove();
  const made = note('bad', title, words);
  made.dataset.words = title + words;
  if (!error.status && error.status !== 0) console.error(error);
}
