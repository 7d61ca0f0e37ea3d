'use strict';
// What the pages share: numbers and lists in words, colours, light and dark. Text only
// ever enters a page as text.

const THEME_KEY = 'outrigger-theme';

/** Light or dark: as chosen, else as the system has it. */
function theme(chosen) {
  let kept = chosen;
  // A page from a file may have no storage.
  try {
    if (chosen) localStorage.setItem(THEME_KEY, chosen);
    else kept = localStorage.getItem(THEME_KEY);
  } catch { /* the system's it is */ }
  const dark = kept ? kept === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
  document.documentElement.dataset.theme = dark ? 'dark' : 'light';
  return dark;
}

/** The smallest of 1, 2, 5, 10, 20 … and their tenths that is no less. */
function roundStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((s) => s * power).find((s) => s >= least * 0.9999);
}

/** A length or coordinate for people; −0 is 0. */
function mm(value, digits = 2) {
  const text = value.toFixed(digits);
  return (/^-0\.?0*$/.test(text) ? text.slice(1) : text).replace('-', '−');
}

/** A height for people: to a hundredth, and to a micrometre where layers need it. */
function height(value) {
  return value.toFixed(3).replace(/0$/, '');
}

/** The value of a colour variable of the page. */
function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** An element with attributes and children; strings become text. */
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === 'onclick') made.addEventListener('click', value);
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

function plural(count, one, many = `${one}s`) {
  return `${count === 0 ? 'no' : count.toLocaleString('en')} ${count === 1 ? one : many}`;
}

/** Areas of all sizes with three digits or so. */
function area(value) {
  return `${mm(value, value < 0.1 ? 4 : value < 10 ? 2 : 1)} mm²`;
}

function place([x, y]) {
  return `X ${mm(x, 1)} Y ${mm(y, 1)}`;
}

/** A list of findings that go to their place when clicked. */
function findingsList(title, items, total, open, row, onPick, rest = 'all are in the report of --json') {
  const list = element('ol', { class: 'found' });
  for (const item of items) {
    const [kind, heading, rest] = row(item);
    const swatch = element('span', { class: 'swatch', style: `background: var(--${kind})` });
    const words = element('span', {}, heading, element('small', {}, rest));
    const button = element('button', { type: 'button', onclick: () => onPick(item, button) }, swatch, words);
    list.append(element('li', {}, button));
  }
  const details = element('details', open ? { open: '' } : {}, element('summary', {}, `${title} (${total.toLocaleString('en')})`), list);
  if (items.length < total) {
    details.append(element('p', { class: 'help' }, `The ${items.length} largest of ${total}; ${rest}.`));
  }
  return details;
}

/** Names and values. */
function table(title, rows, open = false) {
  const list = element('dl');
  for (const [name, value] of rows) list.append(element('dt', {}, name), element('dd', {}, value));
  return element('details', open ? { open: '' } : {}, element('summary', {}, title), list);
}
