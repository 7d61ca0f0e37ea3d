// The temperatures of the last half hour, or of as long as there are some, drawn.
//
// Takes: a printer's id; its samples `[unix_s, nozzle, nozzle_target, bed, bed_target]`, asked once and then as they come.
// Gives: a figure with axes and legend, and the same in words for those who do not see it.
// Does not know: how to heat.

import { el, section } from './dom.js';
import { W } from './words.js';
import { get } from './api.js';
import { store } from './live.js';
import { celsius } from './format.js';
import { fail } from './notice.js';

// How much of it is shown, and a line each so many minutes: the least that has all samples in it.
const SPANS = [[300, 1], [600, 2], [1800, 10]];
const SPAN_S = 1800;
const SIZE = { height: 220, left: 48, right: 8, top: 10, bottom: 24 };
const LEAST_TOP_C = 60;
const LEAST_WORDS_PX = 60;
// Where samples are this many steps apart the printer was away, and the line has a gap.
const GAP_STEPS = 4;
// Line of the sample, and of what it aims at.
const SERIES = [['nozzle', 1, 2], ['bed', 3, 4]];
const WORDS_EVERY_MS = 15_000;

/** A step of the axis: 1, 2 or 5 times a power of ten, with at most five lines. */
function stepOf(top) {
  const least = top / 5;
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= least);
}

function path(samples, column, x, y, gapS) {
  let last = null;
  let words = '';
  for (const sample of samples) {
    const value = sample[column];
    if (Number.isFinite(value)) {
      words += `${last === null || sample[0] - last > gapS ? 'M' : 'L'}${x(sample[0]).toFixed(1)} ${y(value).toFixed(1)}`;
      last = sample[0];
    }
  }
  return words;
}

/** What is drawn: seconds back from the end, and minutes between two lines. */
function spanOf(samples, end) {
  const longest = SPANS[SPANS.length - 1];
  return SPANS.find(([s]) => samples.length && samples[0][0] >= end - s) ?? longest;
}

/** Draws in the width that is there, so that letters keep their size on a small screen. */
function draw(svg, samples, everyS) {
  const end = samples[samples.length - 1]?.[0] ?? Date.now() / 1000;
  const width = Math.max(200, svg.clientWidth);
  svg.setAttribute('viewBox', `0 0 ${width} ${SIZE.height}`);
  const { height, left, right, top, bottom } = SIZE;
  const highest = Math.max(LEAST_TOP_C, ...samples.flatMap((sample) => sample.slice(1).filter(Number.isFinite)));
  const step = stepOf(highest * 1.05);
  const topC = Math.ceil((highest * 1.05) / step) * step;
  const [spanS, everyM] = spanOf(samples, end);
  const x = (s) => left + (1 - (end - s) / spanS) * (width - left - right);
  const y = (c) => top + (1 - c / topC) * (height - top - bottom);
  const parts = [];
  for (let c = 0; c <= topC; c += step) {
    parts.push(el('line', { class: 'grid', x1: left, x2: width - right, y1: y(c), y2: y(c) }), el('text', { x: left - 6, y: y(c) + 4, 'text-anchor': 'end' }, c + step > topC ? `${c} °C` : String(c)));
  }
  const tight = (width - left - right) / (spanS / 60 / everyM) < LEAST_WORDS_PX;
  for (let m = 0; m <= spanS / 60; m += everyM) {
    const at = x(end - m * 60);
    parts.push(el('line', { class: 'grid', x1: at, x2: at, y1: top, y2: height - bottom }));
    // Words that would run into each other are left out, every other one.
    if (tight && (m / everyM) % 2 !== 0) continue;
    parts.push(el('text', { x: at, y: height - 7, 'text-anchor': m === 0 ? 'end' : m * 60 === spanS ? 'start' : 'middle' }, m === 0 ? W.graph.now : W.graph.minutes(m)));
  }
  const shown = samples.filter(([s]) => s >= end - spanS);
  for (const [name, actual, target] of SERIES) {
    const aimed = shown.map((sample) => (sample[target] > 0 ? sample : [sample[0]]));
    parts.push(el('path', { class: `target ${name}`, d: path(aimed, target, x, y, everyS * GAP_STEPS) }));
    parts.push(el('path', { class: `actual ${name}`, d: path(shown, actual, x, y, everyS * GAP_STEPS) }));
  }
  svg.replaceChildren(...parts);
}

function inWords(samples) {
  const last = samples[samples.length - 1];
  if (!last) return W.graph.none;
  const minutes = Math.max(1, Math.round((last[0] - samples[0][0]) / 60));
  return W.graph.figure(minutes, SERIES.map(([name, actual, target]) => {
    const values = samples.map((sample) => sample[actual]).filter(Number.isFinite);
    if (!values.length) return '';
    return W.graph.line(W.graph[name], celsius(last[actual]), celsius(Math.min(...values)), celsius(Math.max(...values)), last[target] > 0 ? celsius(last[target]) : null);
  }).join(' '));
}

export function temperatureGraph(scope, id) {
  const svg = el('svg', { class: 'graph', role: 'img', 'aria-label': W.graph.none });
  const value = (name, column) => el('span', { class: 'key' }, el('span', { class: `dash ${name}` }), W.graph[name], ' ', el('output', { 'aria-live': 'off', data: { column } }, W.none));
  const legend = el('p', { class: 'legend' }, SERIES.map(([name, column]) => value(name, column)), el('span', { class: 'faint' }, W.graph.legend));
  let samples = [];
  let everyS = 2;
  const redraw = () => {
    draw(svg, samples, everyS);
    const last = samples[samples.length - 1];
    for (const output of legend.querySelectorAll('output')) output.textContent = celsius(last?.[Number(output.dataset.column)], 1);
  };
  const add = (sample) => {
    if (samples.length && sample[0] <= samples[samples.length - 1][0]) return;
    samples.push(sample);
    while (samples[0][0] < sample[0] - SPAN_S) samples.shift();
  };
  // The words change seldom: they are to be read, not to run along.
  const describe = () => svg.setAttribute('aria-label', inWords(samples));
  const fetchAll = () => get(`/printers/${encodeURIComponent(id)}/temperatures`).then((told) => {
    everyS = told.every_s || 2;
    const newest = told.samples[told.samples.length - 1]?.[0] ?? 0;
    samples = [...told.samples, ...samples.filter(([s]) => s > newest)];
    redraw();
    describe();
  }).catch(fail);
  // Also after each loss of the connection, so that no hole stays.
  scope.watch(() => store.connection === 'live', (live) => { if (live) fetchAll(); });
  scope.ends.push(store.stream('temperatures', ({ printer, sample }) => {
    if (printer !== id) return;
    add(sample);
    redraw();
  }));
  scope.every(WORDS_EVERY_MS, describe);
  const measured = new ResizeObserver(redraw);
  measured.observe(svg);
  scope.ends.push(() => measured.disconnect());
  return section(W.graph.title, {}, legend, svg);
}
