'use strict';
// Puts the page together: the data, the view, the strip, the findings, the keys.

class Page {
  constructor(job, layers) {
    this.job = job;
    this.layers = layers;
    this.index = 0;
    this.marked = null;
    const survey = surveyed(layers, (kind) => job.classes[kind]?.name === 'aid');
    this.survey = survey;
    const cursor = document.getElementById('cursor');
    const onCursor = (at) => { cursor.textContent = at ? `X ${mm(at[0])}  Y ${mm(at[1])} mm` : ''; };
    this.view = new LayerView(document.getElementById('view'), job.classes, survey.bounds, onCursor);
    this.strip = new Strip(document.getElementById('strip'), layers, survey, job.classes, (index) => this.go(index));
    // Layers where islands appear; in a job without any those where overhangs begin.
    const named = (k, name) => survey.rows[k].some(({ kind }) => job.classes[kind]?.name === name);
    const all = layers.all.map((_, k) => k);
    this.events = all.filter((k) => named(k, 'appears'));
    const what = this.events.length ? 'island' : 'overhang';
    document.getElementById('previous').textContent = `‹ ${what}`;
    document.getElementById('next').textContent = `${what} ›`;
    if (!this.events.length) this.events = all.filter((k) => named(k, 'overhang') && (k === 0 || !named(k - 1, 'overhang')));
    this.legend();
    this.keys();
    this.buttons();
    fillFindings(job, (finding) => this.find(finding));
    new ResizeObserver(() => this.view.resize()).observe(this.view.canvas);
    new ResizeObserver(() => this.strip.resize()).observe(this.strip.canvas);
    this.go(this.events[0] ?? 0);
  }

  /** Shows the layer at a place in `layers.all`. */
  go(index, marked = null) {
    if (!this.layers.all.length) return;
    this.index = Math.min(Math.max(index, 0), this.layers.all.length - 1);
    this.marked = marked;
    const layer = this.layers.all[this.index];
    const below = this.index > 0 ? this.layers.groups(this.index - 1) : [];
    this.view.show(this.layers.groups(this.index), below, marked);
    const last = this.job.report.layers - 1;
    const words = `Layer ${layer.number} of ${last}, Z ${height(layer.top)} mm`;
    const where = document.getElementById('where');
    where.replaceChildren(words, element('small', {}, `  middle at ${height(layer.plane)}`));
    this.strip.set(this.index, words);
    document.getElementById('previous').disabled = !(this.events[0] < this.index);
    document.getElementById('next').disabled = !(this.events[this.events.length - 1] > this.index);
  }

  /** Goes to a finding's layer and place. */
  find(finding) {
    // A layer that is empty or exposed wrongly has no place.
    const box = finding.bbox_mm?.flat();
    this.go(this.layers.indexOf(finding.layer), box);
    if (box) this.view.goTo(box);
    if (matchMedia('(max-width: 860px)').matches) window.scrollTo({ top: 0, behavior: 'smooth' });
  }

  /** The next layer with an event, or the previous one. */
  event(step) {
    const to = step > 0 ? this.events.find((k) => k > this.index) : this.events.findLast((k) => k < this.index);
    if (to !== undefined) this.go(to);
  }

  legend() {
    const legend = document.getElementById('legend');
    const present = new Set(this.survey.rows.flatMap((groups) => groups.map(({ kind }) => kind)));
    const entries = this.job.classes.filter((_, kind) => present.has(kind));
    for (const { name, title } of [...entries, { name: 'below', title: 'outline of the layer below' }]) {
      const box = element('input', { type: 'checkbox', checked: '' });
      box.addEventListener('change', () => {
        if (box.checked) this.view.hidden.delete(name);
        else this.view.hidden.add(name);
        this.view.draw();
      });
      legend.append(element('label', {}, box, element('span', { class: 'swatch', style: `background: var(--${name})` }), title));
    }
  }

  keys() {
    const step = (by) => () => this.go(this.index + by);
    const keys = {
      ArrowUp: step(1), ArrowRight: step(1), ArrowDown: step(-1), ArrowLeft: step(-1),
      PageUp: step(10), PageDown: step(-10),
      Home: () => this.go(0), End: () => this.go(Infinity),
      n: () => this.event(1), p: () => this.event(-1), f: () => this.view.fit(),
      '+': () => this.view.zoom(1.4, this.view.size.map((s) => s / 2)),
      '-': () => this.view.zoom(1 / 1.4, this.view.size.map((s) => s / 2)),
    };
    onKeys(keys);
  }

  buttons() {
    const on = (id, act) => document.getElementById(id).addEventListener('click', act);
    on('up', () => this.go(this.index + 1));
    on('down', () => this.go(this.index - 1));
    on('next', () => this.event(1));
    on('previous', () => this.event(-1));
    on('fit', () => this.view.fit());
    on('theme', () => {
      theme(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark');
      this.strip.picture = null;
      this.strip.draw();
      this.view.draw();
    });
    const { kept } = this.job;
    if (kept.layers < kept.of || kept.left_out) {
      const out = kept.left_out ? ` ${kept.left_out} of the smallest pieces had no room.` : '';
      document.getElementById('kept').textContent = `A page of bounded size: it holds ${kept.layers} of ${kept.of} layers, lines to within ${kept.tolerance_mm} mm.${out}`;
    } else {
      document.getElementById('kept').textContent = `Lines are drawn to within ${kept.tolerance_mm} mm.`;
    }
  }
}

async function start() {
  theme();
  const job = JSON.parse(document.getElementById('job').textContent);
  document.getElementById('file').textContent = job.report.file.split('/').filter(Boolean).pop() ?? job.report.file;
  document.getElementById('facts').textContent = factsOf(job.report);
  if (job.format !== 1) throw new Error(`This page's data has the format ${job.format}, which its script does not know.`);
  const bytes = await inflated(document.getElementById('layers').textContent);
  window.page = new Page(job, new Layers(bytes, job.step_mm));
}

start().catch((error) => {
  const failed = document.getElementById('failed');
  failed.textContent = error.message;
  failed.hidden = false;
});
