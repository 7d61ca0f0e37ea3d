'use strict';
// Puts the turning page together: the scene, the view, the switches, what cannot be held.

/** What can be switched: name, colour, title. */
const SWITCHES = [
  ['part', 'part', 'part'],
  ['demand', 'demand', 'must be held'],
  ['tips', 'tip', 'tips'],
  ['supports', 'branch', 'supports'],
];

/** Known figures in words; of others the key is shown. */
const FIGURES = {
  trunks_on_plate: 'trunks on the plate', landings_on_model: 'landings on the part', landings_on_part: 'landings on the part',
};

/** What comes first of the figures; the others follow as they are. */
const FIRST = ['method', 'tips', 'at_least', 'junctions', 'trunks_on_plate', 'landings_on_model', 'length_mm', 'volume_mm3'];

const UNITS = { mm: 'mm', mm2: 'mm²', mm3: 'mm³', s: 's', deg: '°', g: 'g', ml: 'ml' };

/** A figure's name and value in words, by its key. */
function figure(key, value) {
  const [, stem, unit] = key.match(/^(.*)_([a-z0-9]+)$/) ?? [];
  const known = unit in UNITS && typeof value === 'number';
  const digits = typeof value !== 'number' || Number.isInteger(value) ? 0 : Math.abs(value) < 10 ? 2 : 1;
  const number = (v) => v.toLocaleString('en', { minimumFractionDigits: digits, maximumFractionDigits: digits });
  const text = typeof value === 'number' ? number(value) : typeof value === 'boolean' ? (value ? 'yes' : 'no') : String(value);
  const name = FIGURES[key] ?? (known ? stem : key).replaceAll('_', ' ');
  return [name, known ? `${text} ${UNITS[unit]}` : text];
}

/** The figures of a method: rows, and tables of what is an object itself. */
function figureTables(figures) {
  if (!figures || typeof figures !== 'object') return [];
  const rank = ([key]) => (FIRST.indexOf(key) + 1 || FIRST.length + 1);
  const rows = (of) => Object.entries(of).filter(([, v]) => v !== null && typeof v !== 'object').sort((a, b) => rank(a) - rank(b));
  const words = (key, of) => {
    const unit = UNITS[key === 'seconds' ? 's' : ''];
    return rows(of).map(([k, v]) => {
      const [name, text] = figure(k, v);
      return [name, unit && typeof v === 'number' ? `${v.toFixed(2)} ${unit}` : text];
    });
  };
  const tables = [table('Figures', words('', figures), true)];
  for (const [key, value] of Object.entries(figures)) {
    if (value && typeof value === 'object' && rows(value).length) {
      const title = key.replaceAll('_', ' ');
      tables.push(table(title[0].toUpperCase() + title.slice(1), words(key, value)));
    }
  }
  return tables;
}

class TurnPage {
  constructor(data, scene) {
    Object.assign(this, { data, scene });
    this.method = 0;
    this.hidden = new Set();
    this.solid = false;
    this.cut = Infinity;
    this.picked = null;
    this.button = null;
    this.canvas = document.getElementById('view');
    this.camera = new Camera(this.canvas, data.bounds_mm, scene.sample(), () => this.draw(), (at) => this.tap(at));
    this.legend();
    this.methods();
    this.slider();
    this.keys();
    this.buttons();
    this.load();
    this.canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    this.canvas.addEventListener('webglcontextrestored', () => this.load());
    new ResizeObserver(() => {
      this.painter?.resize();
      this.camera.resized();
    }).observe(this.canvas);
    this.show(0);
    this.fromAddress();
  }

  /** All shapes go to the graphics card. */
  load() {
    this.painter = Painter.on(this.canvas);
    if (!this.painter) {
      const words = 'This browser shows no WebGL, so that the part cannot be drawn here. The list and the figures are complete.';
      document.getElementById('where').textContent = words;
      return;
    }
    this.painter.resize();
    const { lines, side } = this.scene.plate();
    this.side = side;
    this.loaded = {
      part: this.painter.load(this.scene.partSoup()),
      lines: this.painter.load(lines),
      needs: this.painter.load(this.scene.needDots()),
      forests: [],
    };
    this.draw();
  }

  /** Shows a method's supports. */
  show(index) {
    this.method = Math.min(Math.max(index, 0), Math.max(this.data.methods.length - 1, 0));
    this.pick(null);
    this.findings();
    this.draw();
  }

  get shown() {
    return this.data.methods[this.method];
  }

  draw = oncePerFrame(() => this.paint());

  paint() {
    if (!this.painter) return;
    const { loaded, hidden } = this;
    if (this.shown && !loaded.forests[this.method]) {
      const { branches, tips } = this.scene.forestSoups(this.method);
      const marks = marksAt(this.shown.unheld);
      const load = (soup) => this.painter.load(soup);
      loaded.forests[this.method] = { branches: load(branches), tips: load(tips), marks: load(marks) };
    }
    const forest = loaded.forests[this.method];
    const unless = (name, what) => (hidden.has(name) ? null : what);
    this.painter.paint(this.camera, {
      part: unless('part', loaded.part),
      solids: [unless('supports', forest?.branches), unless('tips', forest?.tips)],
      dots: [unless('demand', loaded.needs)],
      lines: loaded.lines,
      marks: forest?.marks,
      picked: this.picked ? loaded.picked : null,
    }, this.cut, this.solid);
    this.label();
  }

  /** The reason beside the place that was picked. */
  label() {
    const label = document.getElementById('label');
    const at = this.picked && this.camera.onScreen(this.picked.place_mm);
    label.hidden = !at;
    if (!at) return;
    label.textContent = this.picked.reason;
    const room = [this.canvas.clientWidth - label.offsetWidth - 8, this.canvas.clientHeight - label.offsetHeight - 8];
    // Below the mark, but above it where the buttons are.
    const y = at[1] + 18 > room[1] - 50 ? at[1] - 18 - label.offsetHeight : at[1] + 18;
    const [left, top] = [at[0] - label.offsetWidth / 2, y].map((c, k) => Math.min(Math.max(c, 8), Math.max(room[k], 8)));
    label.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
  }

  /** Goes to a place that cannot be held; `null`: to none. */
  pick(place, button = null) {
    this.button?.removeAttribute('aria-current');
    this.button = button;
    this.picked = place;
    button?.setAttribute('aria-current', 'true');
    if (place) {
      if (this.loaded) {
        if (this.loaded.picked) this.painter.unload(this.loaded.picked);
        this.loaded.picked = this.painter.load(marksAt([place]));
      }
      if (place.place_mm[2] > this.cut) this.setCut(1);
      const size = 2 * Math.sqrt(place.area_mm2);
      this.camera.goTo(place.place_mm, Math.min(Math.max(8, 3 * size, 0.12 * this.camera.radius), this.camera.radius));
    }
    this.draw();
  }

  /** A click on a mark picks it. */
  tap(at) {
    const apart = (place) => {
      const seen = this.camera.onScreen(place.place_mm);
      return seen ? Math.hypot(seen[0] - at[0], seen[1] - at[1]) : Infinity;
    };
    const nearest = (this.shown?.unheld ?? []).reduce((best, place) => (apart(place) < apart(best ?? place) || !best ? place : best), null);
    if (nearest && apart(nearest) < 16) {
      if (nearest !== this.picked) this.rows.get(nearest)?.click();
    } else if (this.picked) {
      this.pick(null);
    }
  }

  /** The side of the page, for the method that is shown. */
  findings() {
    const { shown, data } = this;
    const verdict = document.getElementById('verdict');
    const at = document.getElementById('findings');
    at.replaceChildren();
    this.rows = new Map();
    if (!shown) {
      verdict.textContent = 'No supports';
      return;
    }
    const { unheld } = shown.totals;
    const needed = data.demand.of > 0;
    verdict.classList.toggle('bad', unheld > 0);
    verdict.textContent = unheld
      ? `${plural(unheld, 'place')} (${area(shown.totals.unheld_area_mm2)}) cannot be held`
      : needed ? 'All that must be held is held' : 'Nothing needs support';
    if (unheld) {
      const row = (item) => [
        'unheld',
        `${item.island ? 'Island' : 'Overhang'} · Z ${mm(item.place_mm[2])} · ${area(item.area_mm2)}`,
        `${place(item.place_mm)} · ${item.reason}`,
      ];
      const list = findingsList('Cannot be held', shown.unheld, unheld, true, row, (item, button) => {
        this.pick(item, button);
        if (matchMedia('(max-width: 860px)').matches) window.scrollTo({ top: 0, behavior: 'smooth' });
      }, 'islands first');
      list.querySelectorAll('button').forEach((button, k) => this.rows.set(shown.unheld[k], button));
      at.append(list);
    }
    at.append(...figureTables(shown.figures));
  }

  legend() {
    const legend = document.getElementById('legend');
    const add = (title, swatch, checked, act) => {
      const box = element('input', { type: 'checkbox', ...(checked ? { checked: '' } : {}) });
      box.addEventListener('change', () => {
        act(box.checked);
        this.draw();
      });
      const mark = swatch ? [element('span', { class: 'swatch', style: `background: var(--${swatch})` })] : [];
      legend.append(element('label', {}, box, ...mark, title));
      return box;
    };
    this.boxes = new Map();
    for (const [name, swatch, title] of SWITCHES) {
      this.boxes.set(name, add(title, swatch, true, (on) => (on ? this.hidden.delete(name) : this.hidden.add(name))));
    }
    this.boxes.set('glass', add('see-through', null, true, (on) => { this.solid = !on; }));
    const kinds = new Set(this.scene.forests.flatMap((nodes) => nodes.map((n) => n.kind)));
    const only = [[kinds.has(LANDING), 'landing', 'foot on the part'], [this.scene.needs.some((n) => n.island), 'begins', 'island begins'], [this.data.methods.some((m) => m.totals.unheld), 'unheld', 'cannot be held']];
    for (const [there, swatch, title] of only) {
      if (there) legend.append(element('span', { class: 'key' }, element('span', { class: 'swatch', style: `background: var(--${swatch})` }), title));
    }
  }

  methods() {
    const select = document.getElementById('method');
    this.data.methods.forEach((method, k) => select.append(element('option', { value: String(k) }, method.name)));
    select.addEventListener('change', () => this.show(Number(select.value)));
    document.getElementById('method-of').hidden = this.data.methods.length < 2;
  }

  slider() {
    const slider = document.getElementById('cut');
    const [low, high] = this.data.bounds_mm.map((corner) => corner[2]);
    this.setCut = (part) => {
      slider.value = String(Math.round(part * 1000));
      // The last step is above everything, the first leaves a first layer.
      this.cut = part >= 1 ? Infinity : Math.max(low, 0) + part * (high - Math.max(low, 0)) + 1e-3;
      const words = part >= 1 ? 'nowhere' : `Z ${mm(this.cut, 1)} mm`;
      document.getElementById('cut-at').textContent = words;
      slider.setAttribute('aria-valuetext', words);
      this.draw();
    };
    slider.addEventListener('input', () => this.setCut(Number(slider.value) / 1000));
    this.setCut(1);
  }

  keys() {
    const { camera } = this;
    const keys = {
      // As if the part was dragged that way.
      ArrowLeft: () => camera.turnBy(7.5, 0), ArrowRight: () => camera.turnBy(-7.5, 0),
      ArrowUp: () => camera.turnBy(0, -7.5), ArrowDown: () => camera.turnBy(0, 7.5),
      '+': () => camera.zoomBy(1.25), '=': () => camera.zoomBy(1.25), '-': () => camera.zoomBy(0.8),
      f: () => camera.reset(), Home: () => camera.reset(), Escape: () => this.pick(null),
    };
    // These have arrow keys of their own.
    onKeys(keys, 'select, input[type="range"]');
  }

  buttons() {
    const on = (id, act) => document.getElementById(id).addEventListener('click', act);
    on('front', () => this.camera.look(0, 0));
    on('side', () => this.camera.look(90, 0));
    on('top', () => this.camera.look(0, 90));
    on('below', () => this.camera.look(0, -90));
    on('fit', () => {
      this.pick(null);
      this.camera.reset();
    });
    on('theme', () => {
      theme(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark');
      this.draw();
    });
  }

  /** The address may say how to look: `#turn=30&tilt=-10&zoom=2&cut=0.5&off=part,glass`. */
  fromAddress() {
    const said = new URLSearchParams(location.hash.slice(1));
    const number = (name, low, high) => {
      const value = parseFloat(said.get(name));
      return Number.isFinite(value) ? Math.min(Math.max(value, low), high) : null;
    };
    const method = number('method', 1, this.data.methods.length);
    if (method !== null) {
      document.getElementById('method').value = String(Math.floor(method) - 1);
      this.show(Math.floor(method) - 1);
    }
    const pick = number('pick', 1, this.shown?.unheld.length ?? 0);
    if (pick) this.rows.get(this.shown.unheld[Math.floor(pick) - 1])?.click();
    for (const name of (said.get('off') ?? '').split(',')) this.boxes.get(name)?.click();
    const cut = number('cut', 0, 1);
    if (cut !== null) this.setCut(cut);
    const [turn, tilt, zoom] = [number('turn', -360, 360), number('tilt', -90, 90), number('zoom', 0.3, 300)];
    const { camera } = this;
    if (turn !== null || tilt !== null) camera.look(turn ?? camera.turn, tilt ?? camera.tilt, 0);
    if (zoom !== null) camera.zoomBy(zoom);
  }
}

/** A sentence on what the page does not show whole. */
function keptOf({ part, demand, methods }, side) {
  const words = side ? [`Squares of the plate: ${side} mm.`] : [];
  const thin = 'A page of bounded size: ';
  if (part.cell_mm) words.push(`${thin}the part is drawn with ${part.count.toLocaleString('en')} of its ${plural(part.of, 'triangle')}, to within ${mm(part.cell_mm * Math.sqrt(3))} mm; supports were planned for all of it.`);
  if (demand.cell_mm) words.push(`${thin}what must be held is gathered in cells of ${mm(demand.cell_mm)} mm.`);
  for (const { name, nodes, of } of methods) {
    if (nodes < of) words.push(`${thin}${nodes.toLocaleString('en')} of ${of.toLocaleString('en')} pieces of ${name} are drawn.`);
  }
  return words.join(' ');
}

function failed(message) {
  const at = document.getElementById('failed');
  at.textContent = message;
  at.hidden = false;
}

async function start() {
  theme();
  const data = JSON.parse(document.getElementById('scene').textContent);
  document.getElementById('file').textContent = data.title;
  const [low, high] = data.bounds_mm;
  const size = [0, 1, 2].map((k) => mm(high[k] - low[k], 1)).join(' × ');
  const facts = [...(data.part.of ? [plural(data.part.of, 'triangle')] : []), `${size} mm with supports`];
  document.getElementById('facts').textContent = facts.join(' · ');
  const notes = document.getElementById('warnings');
  for (const note of data.notes) notes.append(element('li', {}, note));
  notes.hidden = !data.notes.length;
  if (data.format !== 1) throw new Error(`This page's data has the format ${data.format}, which its script does not know.`);
  const bytes = await inflated(document.getElementById('shapes').textContent);
  window.page = new TurnPage(data, new Scene(bytes, data));
  document.getElementById('kept').textContent = keptOf(data, window.page.side);
}

start().catch((error) => failed(error.message));
