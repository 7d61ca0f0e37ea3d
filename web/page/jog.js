// The pad that moves the head, or a resin printer's plate, and homing.
//
// Takes: a printer's id. Gives: a pad of buttons for X, Y and Z with a choice of steps, by mouse, finger or arrow keys.
// Does not know: where the head is; the daemon refuses what would leave the bed.

import { el, section } from './dom.js';
import { W } from './words.js';
import { post } from './api.js';
import { button } from './actions.js';
import { guarded } from './controls.js';
import { fail } from './notice.js';

const STEPS_MM = [0.1, 1, 10, 50];
// Calm speeds that any printer goes; Z axes are mostly slow screws.
const FEED_XY_MM_MIN = 3000;
const FEED_Z_MM_MIN = 600;
// Where each button stands in the pad (a class of the style sheet), and what it moves.
const MOVES = [
  ['y', 1, '↑', 'ArrowUp'], ['y', -1, '↓', 'ArrowDown'], ['x', -1, '←', 'ArrowLeft'], ['x', 1, '→', 'ArrowRight'],
  ['z', 1, '↑', 'PageUp'], ['z', -1, '↓', 'PageDown'],
];

export function jogPanel(scope, id, { plate = false } = {}) {
  const moves = plate ? MOVES.filter(([axis]) => axis === 'z') : MOVES;
  const axes = plate ? ['z'] : ['x', 'y', 'z'];
  const path = `/printers/${encodeURIComponent(id)}/jog`;
  let step = 10;
  const move = (axis, sign) => post(path, { [`${axis}_mm`]: sign * step, feed_mm_min: axis === 'z' ? FEED_Z_MM_MIN : FEED_XY_MM_MIN });
  const home = (axes) => () => post(path, { home: axes });

  const buttons = moves.map(([axis, sign, arrow]) => button(el('span', {}, arrow, el('small', {}, axis.toUpperCase())), () => move(axis, sign),
    { kind: `jog ${axis}${sign > 0 ? 'up' : 'down'}`, key: `${axis}${sign}` }));
  const name = () => buttons.forEach((one, k) => one.setAttribute('aria-label', W.jog.move(moves[k][0].toUpperCase(), `${moves[k][1] < 0 ? '−' : '+'}${step}`)));
  name();

  const steps = el('div', { class: 'segments', role: 'radiogroup', 'aria-label': W.jog.step }, STEPS_MM.map((mm) => el('label', {},
    el('input', { type: 'radio', name: `step-${id}`, value: mm, checked: mm === step, on: { change: () => { step = mm; name(); } } }), el('span', {}, W.jog.mm(mm)))));

  const homeName = plate ? W.jog.homeAxis('Z') : W.jog.homeAll;
  const pad = el('div', { class: plate ? 'pad plate' : 'pad', role: 'group', 'aria-label': W.jog.group }, buttons, button('⌂', home(axes), { kind: `jog ${plate ? 'zhome' : 'middle'}`, 'aria-label': homeName, title: homeName, key: 'home' }));
  let moving = false;
  pad.addEventListener('keydown', async (event) => {
    const known = moves.find(([, , , key]) => key === event.key);
    if (!known || !event.target.closest('.jog')) return;
    event.preventDefault();
    // A key that is held repeats faster than the head moves; what came too fast is left out, not queued.
    if (moving) return;
    moving = true;
    await move(known[0], known[1]).catch(fail);
    moving = false;
  });

  const homes = !plate && el('div', { class: 'row' }, button(W.jog.homeAll, home(axes), { key: 'home all' }),
    axes.map((axis) => button(axis.toUpperCase(), home([axis]), { 'aria-label': W.jog.homeAxis(axis.toUpperCase()), title: W.jog.homeAxis(axis.toUpperCase()), key: `home ${axis}` })));
  return section(W.jog.title, {}, guarded(scope, id, plate ? W.jog.plate : W.jog.pad, steps, pad, homes));
}
