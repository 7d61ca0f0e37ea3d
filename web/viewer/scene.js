'use strict';
// A part with its supports: from the packed bytes to triangles and dots. Draws nothing.
//
// The format is documented in README.md beside this file.

/** What a corner is, as its colour variable is named; the place in the list is its number. */
const KINDS = ['part', 'branch', 'tip', 'landing', 'demand', 'begins', 'unheld', 'grid-strong'];
const kindOf = (name) => KINDS.indexOf(name);

/** Kinds of nodes, in the order of their numbers. */
const [TIP, JOINT, , LANDING] = [0, 1, 2, 3];

/** Bytes of a corner: three floats, a normal of three signed bytes, its kind. */
const STRIDE = 16;

/** A triangle's edge is drawn sharp where the surface turns by more than this (cosine). */
const SMOOTH = 0.82;

/** Nodes of a forest up to which its branches are drawn round and with round joints. */
const ROUND_MAX = 12000;

/** Rings of a round joint. */
const RINGS = 6;

/** Triangles corner by corner, as they go to the graphics card. */
class Soup {
  constructor(corners) {
    this.buffer = new ArrayBuffer(Math.max(corners, 1) * STRIDE);
    this.floats = new Float32Array(this.buffer);
    this.bytes = new Int8Array(this.buffer);
    this.count = 0;
  }

  /** A corner at `[x, y, z]` with a normal of length 1. */
  add(at, normal, kind) {
    const k = this.count++;
    for (let c = 0; c < 3; c++) {
      this.floats[4 * k + c] = at[c];
      this.bytes[STRIDE * k + 12 + c] = Math.round(normal[c] * 127);
    }
    this.bytes[STRIDE * k + 15] = kind;
  }

  get used() {
    return new Uint8Array(this.buffer, 0, this.count * STRIDE);
  }
}

const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => {
  const length = Math.hypot(...a) || 1;
  return [a[0] / length, a[1] / length, a[2] / length];
};

class Scene {
  constructor(bytes, data) {
    this.data = data;
    const reader = new Reader(bytes, 0, bytes.length);
    this.surface = this.readSurface(reader);
    this.needs = this.readNeeds(reader);
    this.forests = data.methods.map(() => this.readForest(reader));
  }

  /** A function that reads places, each as steps from the one before. */
  placesOf(reader) {
    const { step_mm: step, origin_mm: origin } = this.data;
    const at = [0, 0, 0];
    return () => {
      for (let k = 0; k < 3; k++) at[k] += reader.signed();
      return at.map((steps, k) => origin[k] + steps * step);
    };
  }

  /** Vertices as x, y, z one after the other, and three of their numbers a triangle. */
  readSurface(reader) {
    const next = this.placesOf(reader);
    const vertices = [];
    const corners = new Uint32Array(3 * reader.unsigned());
    for (let k = 0, seen = 0; k < corners.length; k++) {
      const age = reader.unsigned();
      corners[k] = seen - age;
      if (age === 0) {
        vertices.push(...next());
        seen += 1;
      }
    }
    return { vertices: new Float32Array(vertices), corners };
  }

  readNeeds(reader) {
    const next = this.placesOf(reader);
    const needs = [];
    for (let left = reader.unsigned(); left > 0; left--) {
      const at = next();
      const area = reader.unsigned();
      needs.push({ at, area: Math.floor(area / 2) * 1e-4, island: area % 2 === 1 });
    }
    return needs;
  }

  readForest(reader) {
    const next = this.placesOf(reader);
    const nodes = [];
    for (let left = reader.unsigned(); left > 0; left--) {
      const kind = reader.unsigned();
      const at = next();
      const radius = reader.unsigned() * this.data.step_mm;
      const down = reader.signed();
      nodes.push({ kind, at, radius, down: down ? nodes.length + down : -1 });
    }
    return nodes;
  }

  /** The part; corners are smooth but where the surface has an edge. Written for speed. */
  partSoup() {
    const { vertices, corners } = this.surface;
    const faces = new Float32Array(corners.length);
    const smooth = new Float32Array(vertices.length);
    for (let k = 0; k < corners.length; k += 3) {
      const [a, b, c] = [3 * corners[k], 3 * corners[k + 1], 3 * corners[k + 2]];
      const [ux, uy, uz] = [vertices[b] - vertices[a], vertices[b + 1] - vertices[a + 1], vertices[b + 2] - vertices[a + 2]];
      const [vx, vy, vz] = [vertices[c] - vertices[a], vertices[c + 1] - vertices[a + 1], vertices[c + 2] - vertices[a + 2]];
      faces[k] = uy * vz - uz * vy;
      faces[k + 1] = uz * vx - ux * vz;
      faces[k + 2] = ux * vy - uy * vx;
      for (const at of [a, b, c]) {
        for (let j = 0; j < 3; j++) smooth[at + j] += faces[k + j];
      }
    }
    for (const normals of [faces, smooth]) {
      for (let k = 0; k < normals.length; k += 3) {
        const length = Math.hypot(normals[k], normals[k + 1], normals[k + 2]) || 1;
        for (let j = 0; j < 3; j++) normals[k + j] /= length;
      }
    }
    const soup = new Soup(corners.length);
    const kind = kindOf('part');
    const three = (list, k) => [list[k], list[k + 1], list[k + 2]];
    for (let k = 0; k < corners.length; k++) {
      const face = three(faces, k - (k % 3));
      const normal = three(smooth, 3 * corners[k]);
      soup.add(three(vertices, 3 * corners[k]), dot(face, normal) > SMOOTH ? normal : face, kind);
    }
    return soup;
  }

  /** A forest's branches and its tips, each as triangles. */
  forestSoups(index) {
    const nodes = this.forests[index];
    const round = nodes.length <= ROUND_MAX;
    const sides = round ? 12 : 6;
    const perNode = 9 * sides + (round ? 6 * sides * RINGS : 0);
    const branches = new Soup(nodes.length * perNode);
    const tips = new Soup(nodes.filter((n) => n.kind === TIP).length * perNode);
    for (const node of nodes) {
      const below = nodes[node.down];
      if (below) {
        const soup = node.kind === TIP ? tips : branches;
        const kind = node.kind === TIP ? 'tip' : below.kind === LANDING ? 'landing' : 'branch';
        addFrustum(soup, node, below, sides, kindOf(kind), node.kind === TIP);
      }
      if (round && node.kind === JOINT) addBall(branches, node, sides, kindOf('branch'));
    }
    return { branches, tips };
  }

  /** What must be held, as dots: place and diameter. */
  needDots() {
    const dots = new Soup(this.needs.length);
    for (const { at, area, island } of this.needs) {
      dots.add(at, [0, 0, 0], kindOf(island ? 'begins' : 'demand'));
      setSize(dots, island ? Math.max(1.2, 2 * Math.sqrt(area / Math.PI)) : Math.max(0.3, 2 * Math.sqrt(area / Math.PI)));
    }
    return dots;
  }

  /** Some thousand places of all that is there, to look at it as a whole. */
  sample() {
    const every = (count, at) => {
      const step = Math.ceil(count / 3000);
      return Array.from({ length: step ? Math.ceil(count / step) : 0 }, (_, k) => at(k * step));
    };
    const nodes = this.forests.flat();
    const { vertices } = this.surface;
    const places = [
      ...every(vertices.length / 3, (k) => [...vertices.subarray(3 * k, 3 * k + 3)]),
      ...every(nodes.length, (k) => nodes[k].at),
    ];
    return places.length ? places : this.data.bounds_mm;
  }

  /** The plate as lines, with a square's side in mm. */
  plate() {
    const [low, high] = this.data.bounds_mm;
    const side = roundStep(Math.max(high[0] - low[0], high[1] - low[1], 1) / 12);
    const from = [0, 1].map((k) => Math.floor(low[k] / side - 0.5) * side);
    const to = [0, 1].map((k) => Math.ceil(high[k] / side + 0.5) * side);
    const lines = new Soup(800);
    for (const k of [0, 1]) {
      const other = 1 - k;
      for (let at = from[k]; at <= to[k] + side / 2; at += side) {
        for (const end of [from[other], to[other]]) {
          lines.add(k ? [end, at, 0] : [at, end, 0], [0, 0, 1], kindOf('grid-strong'));
        }
      }
    }
    return { lines, side };
  }
}

/** Marks of places that cannot be held. */
function marksAt(places) {
  const marks = new Soup(places.length);
  for (const { place_mm: at } of places) marks.add(at, [0, 0, 0], kindOf('unheld'));
  return marks;
}

/** The diameter in mm of the last dot, in place of a normal: up to 25 mm. */
function setSize(dots, size) {
  dots.bytes[STRIDE * (dots.count - 1) + 12] = Math.min(Math.round(size * 5), 127);
}

/** Two directions across a third. */
function across(axis) {
  const u = unit(cross(axis, Math.abs(axis[2]) > 0.9 ? [1, 0, 0] : [0, 0, 1]));
  return [u, cross(axis, u)];
}

/** The side of a branch, closed above where nothing joins. */
function addFrustum(soup, top, low, sides, kind, closed) {
  const axis = unit(minus(top.at, low.at));
  const [u, v] = across(axis);
  const ring = [];
  for (let k = 0; k <= sides; k++) {
    const [x, y] = [Math.cos((2 * Math.PI * k) / sides), Math.sin((2 * Math.PI * k) / sides)];
    const out = [0, 1, 2].map((c) => u[c] * x + v[c] * y);
    const at = (node) => [0, 1, 2].map((c) => node.at[c] + out[c] * node.radius);
    ring.push({ out, above: at(top), below: at(low) });
  }
  for (let k = 0; k < sides; k++) {
    const [a, b] = [ring[k], ring[k + 1]];
    const corners = [[a.above, a.out], [a.below, a.out], [b.below, b.out], [a.above, a.out], [b.below, b.out], [b.above, b.out]];
    for (const [at, normal] of corners) soup.add(at, normal, kind);
    if (closed) for (const at of [top.at, a.above, b.above]) soup.add(at, axis, kind);
  }
}

/** A ball where branches meet or bend. */
function addBall(soup, node, sides, kind) {
  const out = (i, k) => {
    const [a, b] = [(Math.PI * i) / RINGS, (2 * Math.PI * k) / sides];
    return [Math.sin(a) * Math.cos(b), Math.sin(a) * Math.sin(b), Math.cos(a)];
  };
  for (let i = 0; i < RINGS; i++) {
    for (let k = 0; k < sides; k++) {
      const [a, b, c, d] = [out(i, k), out(i + 1, k), out(i + 1, k + 1), out(i, k + 1)];
      for (const normal of [a, b, c, a, c, d]) {
        soup.add(normal.map((n, j) => node.at[j] + n * node.radius * 0.99), normal, kind);
      }
    }
  }
}
