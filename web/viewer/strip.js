'use strict';
// The job from the front, as a slider: where the line is, there is the layer.
// Beside it marks of the layers where islands begin, and bars of how much overhangs.

class Strip {
  /** `onPick` is told the place of a layer in `layers.all`. */
  constructor(canvas, layers, survey, kinds, onPick) {
    Object.assign(this, { canvas, layers, survey, kinds, onPick });
    this.index = 0;
    this.bottom = layers.all[0]?.bottom ?? 0;
    this.top = Math.max(layers.all[layers.all.length - 1]?.top ?? 1, this.bottom + 1e-6);
    canvas.setAttribute('aria-valuemin', '0');
    canvas.setAttribute('aria-valuemax', String(Math.max(layers.all.length - 1, 0)));
    this.listen();
  }

  /** Shows where a layer is. */
  set(index, words) {
    this.index = index;
    this.canvas.setAttribute('aria-valuenow', String(index));
    this.canvas.setAttribute('aria-valuetext', words);
    this.draw();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    this.picture = null;
    this.draw();
  }

  /** Where heights are, px from above. */
  y(z) {
    const room = 16;
    return room + (1 - (z - this.bottom) / (this.top - this.bottom)) * (this.canvas.clientHeight - 2 * room);
  }

  /** The height at a place, mm. */
  z(y) {
    const room = 16;
    const part = 1 - (y - room) / Math.max(this.canvas.clientHeight - 2 * room, 1);
    return this.bottom + Math.min(Math.max(part, 0), 1) * (this.top - this.bottom);
  }

  draw() {
    const pen = this.canvas.getContext('2d');
    const ratio = window.devicePixelRatio || 1;
    if (!this.picture) this.picture = this.silhouette(ratio);
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    if (this.picture.width && this.picture.height) pen.drawImage(this.picture, 0, 0);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const layer = this.layers.all[this.index];
    if (!layer) return;
    const y = this.y(layer.plane);
    const width = this.canvas.clientWidth;
    pen.strokeStyle = colour('accent');
    pen.fillStyle = colour('accent');
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(4, y);
    pen.lineTo(width - 4, y);
    pen.stroke();
    pen.beginPath();
    pen.arc(width - 8, y, 6, 0, 2 * Math.PI);
    pen.fill();
  }

  /** All that does not move, drawn once for each size and theme. */
  silhouette(ratio) {
    const picture = document.createElement('canvas');
    picture.width = this.canvas.width;
    picture.height = this.canvas.height;
    const pen = picture.getContext('2d');
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const width = this.canvas.clientWidth;
    const lanes = 26;
    const { bounds, rows } = this.survey;
    const across = Math.max(bounds[2] - bounds[0], 0.5);
    const up = this.y(this.bottom) - this.y(this.top);
    const scale = Math.min((width - lanes - 14) / across, up / (this.top - this.bottom));
    const middle = (width - lanes) / 2;
    const centre = (bounds[0] + bounds[2]) / 2;
    const overhang = (group) => this.kinds[group.kind]?.name === 'overhang';
    const most = rows.reduce((most, groups) => Math.max(most, groups.find(overhang)?.area ?? 0), 1e-9);
    const order = ['aid', 'body', 'overhang', 'island', 'appears'];
    for (const wanted of order) {
      pen.fillStyle = colour(wanted);
      rows.forEach((groups, k) => {
        const { bottom, top } = this.layers.all[k];
        for (const { kind, area, runs } of groups) {
          if (this.kinds[kind]?.name !== wanted || !runs.length) continue;
          const least = wanted === 'appears' ? 2 : 0.5;
          // On whole pixels, so that no seams show between layers.
          const whole = (px) => Math.round(px * ratio) / ratio;
          const y = whole(this.y(top));
          const height = Math.max(whole(this.y(bottom)) - y, least);
          if (wanted !== 'overhang') {
            for (const [from, to] of runs) {
              // A prime line at the other end of the plate ends where the marks begin.
              const left = Math.max(middle + (from - centre) * scale, 2);
              const right = Math.min(middle + (to - centre) * scale, width - lanes - 4);
              if (right > left - 1) pen.fillRect(left, y, Math.max(right - left, 1), height);
            }
          }
          if (wanted === 'appears') pen.fillRect(width - lanes, y, 10, Math.max(height, 2));
          // As long as the side of a square of that area would be.
          if (wanted === 'overhang') pen.fillRect(width - lanes + 12, y, 12 * Math.sqrt(Math.max(area, 0) / most), height);
        }
      });
    }
    return picture;
  }

  listen() {
    const pick = (event) => {
      const box = this.canvas.getBoundingClientRect();
      this.onPick(this.layers.nearest(this.z(event.clientY - box.top)));
    };
    this.canvas.addEventListener('pointerdown', (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      pick(event);
    });
    this.canvas.addEventListener('pointermove', (event) => {
      if (this.canvas.hasPointerCapture(event.pointerId)) pick(event);
    });
    this.canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.onPick(this.index + (event.deltaY < 0 ? 1 : -1));
    }, { passive: false });
  }
}
