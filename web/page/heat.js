// Heating by hand: presets, a temperature for nozzle and bed, off.
//
// Takes: a printer's id and its limits. Gives: a panel that is switched off, with the reason, while a job heats.
// Does not know: what the printer's firmware makes of it.

import { el, field, section } from './dom.js';
import { W } from './words.js';
import { post } from './api.js';
import { store } from './live.js';
import { button, form } from './actions.js';
import { guarded } from './controls.js';

// What makers of the materials print on their spools, at the lower end.
const PRESETS = [['PLA', 210, 60], ['PETG', 235, 80], ['ABS', 245, 100], ['TPU', 225, 50]];

export function heatPanel(scope, id) {
  const path = `/printers/${encodeURIComponent(id)}/heat`;
  const heat = (values) => post(path, values);
  const limits = () => store.printers.get(id)?.limits ?? {};
  const input = (name) => {
    const made = el('input', { type: 'number', inputmode: 'numeric', min: 0, step: 1, name });
    const hint = el('small', {});
    scope.watch(() => limits()[name] ?? null, (limit) => {
      if (limit !== null) made.max = limit;
      hint.textContent = limit === null ? '' : W.heat.limit(limit);
    });
    return { made, hint };
  };
  const nozzle = input('nozzle_c');
  const bed = input('bed_c');

  const presets = scope.part(limits, ({ nozzle_c: most = Infinity, bed_c: mostBed = Infinity }) => PRESETS
    .filter(([, n, b]) => n <= most && b <= mostBed)
    .map(([name, n, b]) => button(el('span', {}, name, ' ', el('small', {}, `${n} / ${b}`)), () => heat({ nozzle_c: n, bed_c: b }), { title: W.heat.preset(name, n, b), key: name })),
  { class: 'row', role: 'group', 'aria-label': W.heat.presets });

  const own = form([
    field(`${W.heat.nozzle} (${W.heat.unit})`, nozzle.made, nozzle.hint), field(`${W.heat.bed} (${W.heat.unit})`, bed.made, bed.hint),
  ], W.heat.set, async () => {
    const values = {};
    for (const [{ made }, what] of [[nozzle, W.heat.nozzleName], [bed, W.heat.bedName]]) {
      if (made.value === '') continue;
      if (made.max && Number(made.value) > Number(made.max)) throw new Error(W.heat.over(what, made.max));
      values[made.name] = Number(made.value);
    }
    if (!Object.keys(values).length) throw new Error(W.heat.nothing);
    await heat(values);
    nozzle.made.value = bed.made.value = '';
  }, { kind: '', cls: 'heat' });
  own.noValidate = true;

  return section(W.heat.title, {}, guarded(scope, id, W.heat.title,
    el('div', { class: 'between top' }, presets, button(W.heat.off, () => heat({ nozzle_c: 0, bed_c: 0 }), { key: 'off' })), own));
}
