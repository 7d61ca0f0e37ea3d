'use strict';
// Where one looks from, and the mouse, fingers and keys that change it. Draws nothing.

const DEGREE = Math.PI / 180;

/** Half of the angle of view, up and down. */
const HALF_VIEW = 14 * DEGREE;

/** As a part is shown at first: a little from the right and from above. */
const AT_FIRST = { turn: 28, tilt: 14 };

class Camera {
  /** `onChange()` is told of each change, `onTap([x, y])` of a click in CSS pixels. */
  constructor(canvas, bounds, onChange, onTap) {
    Object.assign(this, { canvas, bounds, onChange, onTap });
    this.pointers = new Map();
    Object.assign(this, AT_FIRST, { zoom: 1, centre: this.middle, moved: false });
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
    const [a, t] = [this.turn * DEGREE, this.tilt * DEGREE];
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

  /** Distance from which all is in sight from here, mm. */
  get whole() {
    const axes = this.axes;
    const lens = this.lens;
    const middle = this.middle;
    const room = [0.9, this.canvas.clientHeight > 320 ? 0.78 : 0.7];
    let distance = 0;
    for (let k = 0; k < 8; k++) {
      const corner = minus([0, 1, 2].map((c) => this.bounds[(k >> c) & 1][c]), middle);
      for (const c of [0, 1]) {
        distance = Math.max(distance, (Math.abs(dot(axes[c], corner)) * lens[c]) / room[c] - dot(axes[2], corner));
      }
    }
    return Math.max(distance, 1);
  }

  get distance() {
    return this.whole / this.zoom;
  }

  /** Place → clip space, column by column. */
  get matrix() {
    const [right, up, away] = this.axes;
    const [fx, fy] = this.lens;
    const distance = this.distance;
    const reach = 2.5 * this.radius + Math.hypot(...minus(this.centre, this.middle));
    const near = Math.max(distance - reach, distance / 400);
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
    this.fly({ ...AT_FIRST, zoom: 1, centre: this.middle });
  }

  /** Looks at all from a side. */
  look(turn, tilt) {
    this.fly({ turn, tilt, zoom: 1, centre: this.middle });
  }

  /** Looks at a place from the side where it is, so that `around` mm about it are seen. */
  goTo(at, around) {
    const aside = minus(at, this.middle);
    const turn = Math.hypot(aside[0], aside[1]) > 0.02 * this.radius ? Math.atan2(aside[0], -aside[1]) / DEGREE : this.turn;
    const tilt = at[2] > this.bounds[0][2] + 2 ? -12 : 6;
    const distance = around / Math.tan(HALF_VIEW);
    const before = [this.turn, this.tilt];
    [this.turn, this.tilt] = [turn, tilt];
    const zoom = Math.max(this.whole / distance, 1);
    [this.turn, this.tilt] = before;
    this.fly({ turn, tilt, zoom, centre: at });
  }

  /** On the way there, so that one does not lose one's bearings. */
  fly(to) {
    cancelAnimationFrame(this.flight);
    const from = { turn: this.turn, tilt: this.tilt, zoom: this.zoom, centre: this.centre };
    const round = ((((to.turn - from.turn + 180) % 360) + 360) % 360) - 180;
    const time = matchMedia('(prefers-reduced-motion: reduce)').matches ? 0 : 350;
    const began = performance.now();
    const step = (now) => {
      const part = time ? Math.min(Math.max((now - began) / time, 0), 1) : 1;
      const k = part * part * (3 - 2 * part);
      this.turn = from.turn + round * k;
      this.tilt = from.tilt + (to.tilt - from.tilt) * k;
      this.zoom = from.zoom * (to.zoom / from.zoom) ** k;
      this.centre = from.centre.map((c, j) => c + (to.centre[j] - c) * k);
      this.onChange();
      if (part < 1) this.flight = requestAnimationFrame(step);
    };
    step(time ? began : Infinity);
  }

  /** Turns by degrees. */
  turnBy(aside, up) {
    cancelAnimationFrame(this.flight);
    this.turn = (this.turn + aside) % 360;
    this.tilt = Math.min(Math.max(this.tilt + up, -90), 90);
    this.onChange();
  }

  /** Moves by CSS pixels. */
  moveBy(x, y) {
    cancelAnimationFrame(this.flight);
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
    cancelAnimationFrame(this.flight);
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.3), 300);
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
