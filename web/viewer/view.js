'use strict';
// A layer from above on a canvas: moved and zoomed by mouse, keys and fingers.

class LayerView {
  /** `kinds`: the data's classes by their number; `onCursor` is told mm, or nothing. */
  constructor(canvas, kinds, bounds, onCursor) {
    Object.assign(this, { canvas, kinds, bounds, onCursor });
    this.hidden = new Set();
    this.groups = [];
    this.below = [];
    this.marked = null;
    this.centre = [0, 0];
    this.scale = 1;
    this.fitted = true;
    this.pointers = new Map();
    this.listen();
  }

  /** Shows a layer over the outlines of the one below. */
  show(groups, below, marked) {
    Object.assign(this, { groups, below, marked });
    this.draw();
  }

  /** Height in CSS pixels that buttons cover below: on narrow screens all of the width. */
  get covered() {
    return this.canvas.clientWidth < 560 ? 52 : 0;
  }

  /** Size in CSS pixels. */
  get size() {
    return [this.canvas.clientWidth, this.canvas.clientHeight];
  }

  /** All in sight. */
  fit(box = this.bounds, fill = 0.86) {
    const [width, height] = this.size;
    const across = Math.max(box[2] - box[0], 0.5);
    const up = Math.max(box[3] - box[1], 0.5);
    this.scale = Math.min((width * fill) / across, (Math.max(height - 110, 80) * fill) / up);
    this.centre = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
    this.fitted = box === this.bounds;
    this.draw();
  }

  /** Near a place, but with enough around it to know it again. */
  goTo(box) {
    const margin = Math.max(box[2] - box[0], box[3] - box[1], 2);
    this.fit([box[0] - margin, box[1] - margin, box[2] + margin, box[3] + margin]);
  }

  resize() {
    const [width, height] = this.size;
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(width * ratio));
    this.canvas.height = Math.max(1, Math.round(height * ratio));
    if (this.fitted) this.fit();
    else this.draw();
  }

  toPx([x, y]) {
    const [width, height] = this.size;
    return [width / 2 + (x - this.centre[0]) * this.scale, height / 2 - (y - this.centre[1]) * this.scale];
  }

  toMm([px, py]) {
    const [width, height] = this.size;
    return [this.centre[0] + (px - width / 2) / this.scale, this.centre[1] - (py - height / 2) / this.scale];
  }

  draw = oncePerFrame(() => this.paint());

  paint() {
    const pen = this.canvas.getContext('2d');
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = this.size;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    this.grid(pen, width, height);
    const rings = [];
    for (const { kind, polygons } of this.groups) {
      const name = this.kinds[kind]?.name;
      if (!name || this.hidden.has(name)) continue;
      pen.fillStyle = colour(name);
      pen.fill(this.path(polygons), 'evenodd');
      if (name === 'appears') rings.push(...this.tiny(polygons));
    }
    if (!this.hidden.has('below')) this.outlines(pen);
    pen.strokeStyle = colour('appears');
    pen.lineWidth = 1.5;
    // With more, rings are all that would be seen.
    for (const [x, y] of rings.slice(0, 200)) this.ring(pen, x, y, 11);
    if (this.marked) this.mark(pen, this.marked);
    this.scaleBar(pen, height);
  }

  path(polygons) {
    const path = new Path2D();
    for (const ring of polygons.flat()) {
      for (let k = 0; k < ring.length; k += 2) {
        const [x, y] = this.toPx([ring[k], ring[k + 1]]);
        if (k) path.lineTo(x, y);
        else path.moveTo(x, y);
      }
      path.closePath();
    }
    return path;
  }

  /** The layer below as a dashed line: what this one can stand on. */
  outlines(pen) {
    pen.strokeStyle = colour('below');
    pen.lineWidth = 1;
    pen.setLineDash([4, 3]);
    for (const { kind, polygons } of this.below) {
      if (this.kinds[kind] && this.kinds[kind].name !== 'overhang') pen.stroke(this.path(polygons));
    }
    pen.setLineDash([]);
  }

  /** Middles of polygons that are hard to see, px. */
  tiny(polygons) {
    const found = [];
    for (const [outer] of polygons) {
      const box = ringBounds(outer);
      if (Math.max(box[2] - box[0], box[3] - box[1]) * this.scale < 14) {
        found.push(this.toPx([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]));
      }
    }
    return found;
  }

  ring(pen, x, y, radius) {
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    pen.stroke();
  }

  mark(pen, box) {
    const [left, top] = this.toPx([box[0], box[3]]);
    const [right, bottom] = this.toPx([box[2], box[1]]);
    const room = 7;
    pen.strokeStyle = colour('accent');
    pen.lineWidth = 1.5;
    pen.setLineDash([5, 4]);
    pen.strokeRect(left - room, top - room, right - left + 2 * room, bottom - top + 2 * room);
    pen.setLineDash([]);
  }

  grid(pen, width, height) {
    const step = roundStep(56 / this.scale);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const [left, top] = this.toMm([0, 0]);
    const [right, bottom] = this.toMm([width, height]);
    pen.font = '11px system-ui, sans-serif';
    pen.fillStyle = colour('faint');
    pen.lineWidth = 1;
    const line = (from, to) => {
      pen.beginPath();
      pen.moveTo(...from.map((c) => Math.round(c) + 0.5));
      pen.lineTo(...to.map((c) => Math.round(c) + 0.5));
      pen.stroke();
    };
    const label = (words, x, y) => {
      pen.lineWidth = 3;
      pen.strokeStyle = colour('paper');
      pen.strokeText(words, x, y);
      pen.fillText(words, x, y);
      pen.lineWidth = 1;
    };
    const strong = (k) => colour(k === 0 ? 'grid-strong' : 'grid');
    const labels = [];
    for (let k = Math.ceil(left / step); k * step <= right; k++) {
      const [x] = this.toPx([k * step, 0]);
      pen.strokeStyle = strong(k);
      line([x, 0], [x, height]);
      if (x > (this.covered ? 110 : 30) && x < width - 20) labels.push([mm(k * step, digits), x, height - (this.covered || 50) - 12, 'center']);
    }
    for (let k = Math.ceil(bottom / step); k * step <= top; k++) {
      const [, y] = this.toPx([0, k * step]);
      pen.strokeStyle = strong(k);
      line([0, y], [width, y]);
      if (y > 56 && y < height - 80 - this.covered) labels.push([mm(k * step, digits), 6, y - 3, 'left']);
    }
    for (const [words, x, y, align] of labels) {
      pen.textAlign = align;
      label(words, x, y);
    }
  }

  scaleBar(pen, height) {
    const length = roundStep(60 / this.scale);
    const [x, y] = [14, height - 20 - this.covered];
    const end = x + length * this.scale;
    pen.strokeStyle = colour('ink');
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(x, y - 5);
    pen.lineTo(x, y);
    pen.lineTo(end, y);
    pen.lineTo(end, y - 5);
    pen.stroke();
    pen.fillStyle = colour('ink');
    pen.textAlign = 'left';
    pen.fillText(`${Number(length.toPrecision(3))} mm`, x, y - 9);
  }

  /** Zooms about a place on the screen. */
  zoom(factor, at) {
    const before = this.toMm(at);
    this.scale = Math.min(Math.max(this.scale * factor, 0.02), 20000);
    const after = this.toMm(at);
    this.centre = [this.centre[0] + before[0] - after[0], this.centre[1] + before[1] - after[1]];
    this.fitted = false;
    this.draw();
  }

  listen() {
    const at = (event) => {
      const box = this.canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const canvas = this.canvas;
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 30 : 1;
      this.zoom(Math.exp(-event.deltaY * lines * 0.0016), at(event));
    }, { passive: false });
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, at(event));
      canvas.classList.add('dragging');
    });
    canvas.addEventListener('pointermove', (event) => {
      this.onCursor(this.toMm(at(event)));
      if (this.pointers.has(event.pointerId)) this.drag(event.pointerId, at(event));
    });
    for (const end of ['pointerup', 'pointercancel']) {
      canvas.addEventListener(end, (event) => {
        this.pointers.delete(event.pointerId);
        if (!this.pointers.size) canvas.classList.remove('dragging');
      });
    }
    canvas.addEventListener('pointerleave', () => this.onCursor(null));
    canvas.addEventListener('dblclick', (event) => this.zoom(2, at(event)));
  }

  /** One finger moves, two zoom. */
  drag(id, now) {
    const before = this.pointers.get(id);
    const other = [...this.pointers].find(([key]) => key !== id)?.[1];
    this.pointers.set(id, now);
    if (other) {
      const apart = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1);
      this.zoom(apart(now) / apart(before), other);
      return;
    }
    this.centre = [
      this.centre[0] - (now[0] - before[0]) / this.scale,
      this.centre[1] + (now[1] - before[1]) / this.scale,
    ];
    this.fitted = false;
    this.draw();
  }
}
