// The console: what is said between the daemon and the printer, and a line to say something.
//
// Takes: a printer's id; lines `{at_unix_s, from, text}`. Gives: a log, and an input with what was sent before on the
// arrow keys. While a job has the printer it is for administrators only.
// Does not know: G-code.

import { el, section, tick } from './dom.js';
import { W } from './words.js';
import { get, may, post } from './api.js';
import { store } from './live.js';
import { blocked } from './controls.js';
import { form } from './actions.js';
import { clock } from './format.js';
import { fail } from './notice.js';

const MOST_LINES = 500;
const MOST_HISTORY = 50;
// What printers say of temperatures by themselves or when asked, every few seconds.
const TEMPERATURES = /^(ok )?\s*(T\d?:|B:)\s*-?\d|^M105\b/;

function entry({ at_unix_s, from, text }) {
  return el('div', { class: `line ${from}${TEMPERATURES.test(text) ? ' warmth' : ''}` },
    el('time', {}, clock(new Date(at_unix_s * 1000), true)), el('span', { class: 'from' }, W.console.from[from] ?? from), el('span', { class: 'text' }, text));
}

/** What was sent, and the way through it by the arrow keys. */
function history(input) {
  const sent = [];
  let at = 0;
  let draft = '';
  input.addEventListener('keydown', (event) => {
    if (event.key !== 'ArrowUp' && event.key !== 'ArrowDown') return;
    event.preventDefault();
    if (at === sent.length) draft = input.value;
    at = Math.min(sent.length, Math.max(0, at + (event.key === 'ArrowUp' ? -1 : 1)));
    input.value = at === sent.length ? draft : sent[at];
    input.setSelectionRange(input.value.length, input.value.length);
  });
  return (text) => {
    if (sent[sent.length - 1] !== text) sent.push(text);
    if (sent.length > MOST_HISTORY) sent.shift();
    at = sent.length;
    draft = '';
  };
}

const same = (a, b) => a.at_unix_s === b.at_unix_s && a.from === b.from && a.text === b.text;

/** Of lines that came by the stream those that are not in what was fetched already, and what of that the stream has still to tell. */
export function unseen(lines, fetched) {
  for (let from = Math.max(0, fetched.length - MOST_LINES); from < fetched.length; from += 1) {
    const told = Math.min(lines.length, fetched.length - from);
    if (lines.slice(0, told).every((line, k) => same(line, fetched[from + k]))) return [lines.slice(told), fetched.slice(from + told)];
  }
  return [lines, []];
}

export function consolePanel(scope, id, { melts }) {
  const path = `/printers/${encodeURIComponent(id)}`;
  // It would be read without end; who wants to hear it goes into it.
  const log = el('div', { class: 'log', role: 'log', 'aria-live': 'off', 'aria-label': W.console.log, tabindex: 0 });
  const atEnd = () => log.scrollHeight - log.scrollTop - log.clientHeight < 30;
  const add = (lines, anew = false) => {
    const follow = anew || atEnd();
    if (anew) log.replaceChildren();
    log.querySelector('.nothing')?.remove();
    log.append(...lines.map(entry));
    while (log.children.length > MOST_LINES) log.firstChild.remove();
    if (!log.children.length) log.append(el('p', { class: 'faint nothing' }, W.console.none));
    if (follow) log.scrollTop = log.scrollHeight;
  };
  // The stream goes on while what was said is fetched: it may tell some of that again.
  let fetched = [];
  scope.watch(() => store.connection === 'live', (live) => {
    if (live) get(`${path}/console`).then(({ lines }) => { fetched = lines; add(lines, true); }).catch(fail);
  });
  scope.ends.push(store.stream('console', ({ printer, lines }) => {
    if (printer !== id) return;
    [lines, fetched] = unseen(lines, fetched);
    add(lines);
  }));

  const input = el('input', { class: 'mono', 'aria-label': W.console.input, autocomplete: 'off', autocapitalize: 'characters', spellcheck: 'false', placeholder: 'M115' });
  const remember = history(input);
  const why = el('p', { class: 'reason', id: `console-why-${id}`.replace(/\W+/g, '-') });
  const line = form([input], W.console.send, async () => {
    const text = input.value.trim();
    if (!text) return;
    await post(`${path}/gcode`, { commands: [text] });
    remember(text);
    input.value = '';
  }, { kind: '', cls: 'say' });
  const set = el('fieldset', { 'aria-describedby': why.id }, el('legend', { class: 'unseen' }, W.console.input), line);
  scope.watch(() => [blocked(store.printers.get(id), may('admin') ? null : W.blocked.consoleBusy), store.printers.get(id)?.state === 'busy'], ([reason, busy]) => {
    why.textContent = reason ?? (busy ? W.blocked.consoleAdmin : W.console.hint);
    set.disabled = Boolean(reason);
  });
  const hide = melts && tick(W.console.hide, { checked: true, on: { change: (event) => log.classList.toggle('all', !event.target.checked) } });
  return section(W.console.title, {}, log, set, el('div', { class: 'between' }, why, hide));
}
