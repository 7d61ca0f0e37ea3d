// What a view listens to, so that all of it ends with the view.
//
// Takes: a store with `subscribe`. Gives: watched values, parts that are drawn anew when their data changes,
// listeners and timers, all of which `dispose` ends.
// Does not know: what the store holds, nor any view.

import { el } from './dom.js';

export class Scope {
  constructor(store) {
    this.store = store;
    this.ends = [];
  }

  /** Does `apply` now and whenever what `select` gives is another value (compared as JSON). */
  watch(select, apply) {
    let last;
    const look = () => {
      const value = select();
      const text = JSON.stringify(value) ?? '';
      if (text === last) return;
      last = text;
      apply(value);
    };
    look();
    this.ends.push(this.store.subscribe(look));
  }

  /** A text that follows the store. */
  text(select, tag = 'span', attributes = {}) {
    const made = el(tag, attributes);
    this.watch(select, (value) => { made.textContent = value ?? ''; });
    return made;
  }

  /**
   * An element whose children are drawn anew when the selected data changes. The focus stays on the element of the
   * same `data-key`; if that is gone, it goes to the part itself rather than to the top of the page.
   */
  part(select, draw, attributes = { class: 'part' }, tag = 'div') {
    const made = el(tag, attributes);
    let inner = null;
    this.watch(select, (value) => {
      const focused = made.contains(document.activeElement) && document.activeElement !== made ? document.activeElement : null;
      const key = focused?.dataset.key;
      inner?.dispose();
      inner = new Scope(this.store);
      made.replaceChildren(...[draw(value, inner)].flat(9).filter(Boolean));
      if (!focused) return;
      const again = key && [...made.querySelectorAll('[data-key]')].find((other) => other.dataset.key === key && !other.disabled);
      if (!again) made.tabIndex = -1;
      (again || made).focus({ preventScroll: true });
    });
    this.ends.push(() => inner?.dispose());
    return made;
  }

  on(target, type, act, options) {
    target.addEventListener(type, act, options);
    this.ends.push(() => target.removeEventListener(type, act, options));
  }

  every(ms, act) {
    const timer = setInterval(act, ms);
    this.ends.push(() => clearInterval(timer));
  }

  dispose() {
    for (const end of this.ends.splice(0)) end();
  }
}
