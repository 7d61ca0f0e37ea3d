'use strict';
// Where one looks from, and the mouse, fingers and keys that change it. Draws nothing.

const DEGREE = Math.PI / 180;

/** Half of the angle of view, up and down. */
const HALF_VIEW = 14 * DEGREE;

/** As a part is shown at first: a little from the right and from above. */
const AT_FIRST = { turn: 28, tilt: 14 };

class Camera {
  /** `places`: some of all that is there; `onChange()` is told of each change, `onTap([x, y])` of a click in CSS pixels. */
  constructor(canvas, bounds, places, onChange, onTap) {
    Object.assign(this, { canvas, bounds, places, onChange, onTap });
    this.pointers = new Map();
    this.fitted = true;
    Object.assign(this, this.whole(AT_FIRST.turn, AT_FIRST.tilt));
    this.listen();
  }

  get middle() {
    const [low, high] = this.bounds;
    return low.map((c, k) => (c + high[k]) / 2);
  }

  /** Half of the diagonal of all that is there, mm. */
  get radius() {
    const [low, high] = this.bounds;
    return Math.max(Math.hypot(...minus(high, low)) / 2, 0.5);
  }

  /** To the right, upward and away from the eye. */
  get axes() {
    return this.axesOf(this.turn, this.tilt);
  }

  axesOf(turn, tilt) {
    const [a, t] = [turn * DEGREE, tilt * DEGREE];
    const [sa, ca, st, ct] = [Math.sin(a), Math.cos(a), Math.sin(t), Math.cos(t)];
    return [[ca, sa, 0], [-sa * st, ca * st, ct], [-sa * ct, ca * ct, -st]];
  }

  /** Width by height. */
  get aspect() {
    return Math.max(this.canvas.clientWidth, 1) / Math.max(this.canvas.clientHeight, 1);
  }

  /** Scales of what is one unit away, across and up. */
  get lens() {
    const up = 1 / Math.tan(HALF_VIEW);
    return [up / this.aspect, up];
  }

  /** The view of all from a side, as near as may be. */
  whole(turn, tilt) {
    const axes = this.axesOf(turn, tilt);
    const lens = this.lens;
    // Buttons lie over the lower end.
    const room = [0.92, 0.84];
    const centre = this.middle;
    let distance = 1;
    // Twice: what is near is seen larger, so that the middle depends on the distance.
    for (const last of [false, true]) {
      const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
      let needed = 1;
      for (const place of this.places) {
        const off = minus(place, centre);
        const away = dot(axes[2], off);
        for (const c of [0, 1]) {
          const aside = dot(axes[c], off);
          low[c] = Math.min(low[c], aside);
          high[c] = Math.max(high[c], aside);
          needed = Math.max(needed, (Math.abs(aside) * lens[c]) / room[c] - away);
        }
      }
      distance = needed;
      if (last || low[0] > high[0]) break;
      for (let k = 0; k < 3; k++) centre[k] += (axes[0][k] * (low[0] + high[0]) + axes[1][k] * (low[1] + high[1])) / 2;
    }
    return { turn, tilt, distance, centre };
  }

  /** Place → clip space, column by column. */
  get matrix() {
    const [right, up, away] = this.axes;
    const [fx, fy] = this.lens;
    const distance = this.distance;
    const reach = 2.5 * this.radius + Math.hypot(...minus(this.centre, this.middle));
    const near = Math.max(distance - reach, distance / 60);
    const far = distance + reach;
    const [p, q] = [(far + near) / (far - near), (-2 * far * near) / (far - near)];
    const from = [right, up, away].map((axis) => -dot(axis, this.centre));
    const columns = [0, 1, 2].map((c) => [right[c] * fx, up[c] * fy, away[c] * p, away[c]]);
    const depth = from[2] + distance;
    return new Float32Array([...columns.flat(), from[0] * fx, from[1] * fy, depth * p + q, depth]);
  }

  /** Where a place is seen, CSS pixels; nothing for what is behind the eye. */
  onScreen([x, y, z]) {
    const m = this.matrix;
    const row = (k) => m[k] * x + m[4 + k] * y + m[8 + k] * z + m[12 + k];
    const w = row(3);
    if (w <= 0) return null;
    return [(0.5 + row(0) / w / 2) * this.canvas.clientWidth, (0.5 - row(1) / w / 2) * this.canvas.clientHeight];
  }

  reset() {
    this.look(AT_FIRST.turn, AT_FIRST.tilt);
  }

  /** Looks at all from a side, after so many ms. */
  look(turn, tilt, time = 350) {
    this.fly(this.whole(turn, tilt), time);
    this.fitted = true;
  }

  /** The canvas has another size. */
  resized() {
    if (this.fitted) Object.assign(this, this.whole(this.turn, this.tilt));
    this.onChange();
  }

  /** Looks at a place from the side where it is, so that `around` mm about it are seen. */
  goTo(at, around) {
    const aside = minus(at, this.middle);
    const turn = Math.hypot(aside[0], aside[1]) > 0.02 * this.radius ? Math.atan2(aside[0], -aside[1]) / DEGREE : this.turn;
    const tilt = at[2] > this.bounds[0][2] + 2 ? -12 : 6;
    const distance = around / Math.tan(HALF_VIEW) / Math.min(this.aspect, 1);
    this.fly({ turn, tilt, distance, centre: [...at] });
  }

  /** On the way there, so that one does not lose one's bearings. */
  fly(to, wanted = 350) {
    this.own();
    const from = { turn: this.turn, tilt: this.tilt, distance: this.distance, centre: this.centre };
    const round = ((((to.turn - from.turn + 180) % 360) + 360) % 360) - 180;
    const time = matchMedia('(prefers-reduced-motion: reduce)').matches ? 0 : wanted;
    const began = performance.now();
    const step = (now) => {
      const part = time ? Math.min(Math.max((now - began) / time, 0), 1) : 1;
      const k = part * part * (3 - 2 * part);
      this.turn = from.turn + round * k;
      this.tilt = from.tilt + (to.tilt - from.tilt) * k;
      this.distance = from.distance * (to.distance / from.distance) ** k;
      this.centre = from.centre.map((c, j) => c + (to.centre[j] - c) * k);
      this.onChange();
      if (part < 1) this.flight = requestAnimationFrame(step);
    };
    step(time ? began : Infinity);
  }

  /** From here on the view is whoever's that calls. */
  own() {
    cancelAnimationFrame(this.flight);
    this.fitted = false;
  }

  /** Turns by degrees. */
  turnBy(aside, up) {
    this.own();
    this.turn = (this.turn + aside) % 360;
    this.tilt = Math.min(Math.max(this.tilt + up, -90), 90);
    this.onChange();
  }

  /** Moves by CSS pixels. */
  moveBy(x, y) {
    this.own();
    const [right, up] = this.axes;
    const perPx = (2 * this.distance * Math.tan(HALF_VIEW)) / Math.max(this.canvas.clientHeight, 1);
    const [low, high] = this.bounds;
    this.centre = this.centre.map((c, k) => {
      const moved = c - right[k] * x * perPx + up[k] * y * perPx;
      return Math.min(Math.max(moved, low[k]), high[k]);
    });
    this.onChange();
  }

  zoomBy(factor) {
    this.own();
    this.distance = Math.min(Math.max(this.distance / factor, this.radius / 60), this.radius * 30);
    this.onChange();
  }

  listen() {
    const canvas = this.canvas;
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY * (event.deltaMode === 1 ? 30 : 1) * 0.0014));
    }, { passive: false });
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      if (!this.pointers.size) this.moved = false;
      else this.moved = true;
      this.pointers.set(event.pointerId, { at: at(event), from: at(event) });
      canvas.classList.add('dragging');
    });
    canvas.addEventListener('pointermove', (event) => {
      if (this.pointers.has(event.pointerId)) this.drag(event, at(event));
    });
    for (const end of ['pointerup', 'pointercancel']) {
      canvas.addEventListener(end, (event) => {
        const known = this.pointers.delete(event.pointerId);
        if (known && end === 'pointerup' && !this.moved) this.onTap(at(event));
        if (!this.pointers.size) canvas.classList.remove('dragging');
      });
    }
    canvas.addEventListener('dblclick', () => this.reset());
  }

  /** One finger turns; two move and zoom, as the right button and Shift move. */
  drag(event, now) {
    const pointer = this.pointers.get(event.pointerId);
    const [x, y] = [now[0] - pointer.at[0], now[1] - pointer.at[1]];
    if (Math.hypot(now[0] - pointer.from[0], now[1] - pointer.from[1]) > 4) this.moved = true;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    const apart = (p) => Math.max(Math.hypot(p[0] - other.at[0], p[1] - other.at[1]), 1);
    const factor = other ? apart(now) / apart(pointer.at) : 1;
    pointer.at = now;
    if (!this.moved) return;
    if (other) {
      this.moveBy(x / 2, y / 2);
      this.zoomBy(factor);
    } else if (event.buttons & 2 || event.shiftKey) {
      this.moveBy(x, y);
    } else {
      this.turnBy(-x * 0.4, y * 0.4);
    }
  }
}
