'use strict';
// The layers of a job: from the packed bytes to polygons.
//
// The format is documented in README.md beside this file. Nothing here draws.

/** The bytes of a base64 text, inflated. */
async function inflated(base64) {
  if (typeof DecompressionStream === 'undefined') {
    throw new Error('This browser cannot unpack the data of this page (it knows no DecompressionStream). Firefox 113, Chrome 80, Safari 16.4 and later can.');
  }
  const text = atob(base64.trim());
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Reads varints: seven bits a byte, the lowest first. */
class Reader {
  constructor(bytes, at, end) {
    this.bytes = bytes;
    this.at = at;
    this.end = end;
  }

  unsigned() {
    let value = 0;
    let factor = 1;
    for (;;) {
      if (this.at >= this.end) throw new Error('The page is incomplete: its data ends too early.');
      const byte = this.bytes[this.at++];
      // Not shifted: heights in µm may need more than 32 bits.
      value += (byte & 0x7f) * factor;
      if (byte < 0x80) return value;
      factor *= 128;
    }
  }

  signed() {
    const value = this.unsigned();
    return value % 2 ? -(value + 1) / 2 : value / 2;
  }
}

/** The layers of a job; polygons are decoded when they are asked for. */
class Layers {
  constructor(bytes, stepMm) {
    this.bytes = bytes;
    this.stepMm = stepMm;
    this.all = [];
    const reader = new Reader(bytes, 0, bytes.length);
    while (reader.at < bytes.length) {
      const number = reader.unsigned();
      const bottom = reader.unsigned() / 1000;
      const top = reader.unsigned() / 1000;
      const length = reader.unsigned();
      this.all.push({ number, bottom, top, plane: (bottom + top) / 2, from: reader.at, to: reader.at + length });
      reader.at += length;
    }
    this.last = { index: -1, groups: [] };
  }

  /** `[{kind, polygons: [[Float64Array of x, y in mm, a ring]]}]`, in the order of drawing. */
  groups(index) {
    if (this.last.index === index) return this.last.groups;
    const { from, to } = this.all[index];
    const reader = new Reader(this.bytes, from, to);
    let x = 0;
    let y = 0;
    const list = (read) => {
      const items = [];
      for (let left = reader.unsigned(); left > 0; left--) items.push(read());
      return items;
    };
    const ring = () => {
      const points = reader.unsigned();
      const ring = new Float64Array(2 * points);
      for (let k = 0; k < points; k++) {
        x += reader.signed();
        y += reader.signed();
        ring[2 * k] = x * this.stepMm;
        ring[2 * k + 1] = y * this.stepMm;
      }
      return ring;
    };
    const groups = list(() => ({ kind: reader.unsigned(), polygons: list(() => list(ring)) }));
    this.last = { index, groups };
    return groups;
  }

  /** The place in `all` of the layer nearest to a height in mm. */
  nearest(z) {
    let [low, high] = [0, this.all.length - 1];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.all[middle].top < z) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** The place in `all` of a layer by its number, or of the next one that is there. */
  indexOf(number) {
    const index = this.all.findIndex((layer) => layer.number >= number);
    return index < 0 ? this.all.length - 1 : index;
  }
}

/** Lowest and highest x, y of a ring. */
function ringBounds(ring) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (let k = 0; k < ring.length; k += 2) {
    if (ring[k] < box[0]) box[0] = ring[k];
    if (ring[k + 1] < box[1]) box[1] = ring[k + 1];
    if (ring[k] > box[2]) box[2] = ring[k];
    if (ring[k + 1] > box[3]) box[3] = ring[k + 1];
  }
  return box;
}

/**
 * One pass over all layers: the bounds of the part (`isAid` tells the kinds that
 * are none; without a part those of everything), and for each layer the stretches
 * of x that are seen from the front and the area, by kind.
 */
function surveyed(layers, isAid) {
  const empty = () => [Infinity, Infinity, -Infinity, -Infinity];
  const [part, aid] = [empty(), empty()];
  const rows = layers.all.map((_, index) =>
    layers.groups(index).map(({ kind, polygons }) => {
      const runs = [];
      const bounds = isAid(kind) ? aid : part;
      for (const [outer] of polygons) {
        if (!outer || !outer.length) continue;
        const box = ringBounds(outer);
        bounds[0] = Math.min(bounds[0], box[0]);
        bounds[1] = Math.min(bounds[1], box[1]);
        bounds[2] = Math.max(bounds[2], box[2]);
        bounds[3] = Math.max(bounds[3], box[3]);
        runs.push([box[0], box[2]]);
      }
      // Holes run the other way, so that the sum is what is left.
      const area = polygons.flat().reduce((sum, ring) => sum + ringArea(ring), 0);
      return { kind, area, runs: united(runs) };
    }),
  );
  const bounds = [part, aid].find((box) => box[0] <= box[2]) ?? [0, 0, 1, 1];
  return { bounds, rows };
}

/** Area inside of a ring, mm². */
function ringArea(ring) {
  let sum = 0;
  for (let k = 0, last = ring.length - 2; k < ring.length; last = k, k += 2) {
    sum += ring[last] * ring[k + 1] - ring[k] * ring[last + 1];
  }
  return sum / 2;
}

/** Stretches in order, overlapping ones made one. */
function united(runs) {
  runs.sort((a, b) => a[0] - b[0]);
  const out = [];
  for (const run of runs) {
    const last = out[out.length - 1];
    if (last && run[0] <= last[1]) last[1] = Math.max(last[1], run[1]);
    else out.push(run);
  }
  return out;
}
