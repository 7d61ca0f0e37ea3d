// Makes elements.
//
// Takes: a tag, attributes, children. Gives: elements, whose texts are text nodes and never markup.
// Does not know: what they are for, nor where they come to stand.

const SVG = 'http://www.w3.org/2000/svg';
const SVG_TAGS = new Set(['svg', 'path', 'line', 'g', 'text', 'circle', 'rect', 'title']);

/**
 * An element. `on` holds listeners by name, `data` the data attributes; true stands for an attribute without a
 * value, and null, undefined and false for none. Styles as text are refused, since the policy of the page would drop
 * them without a word.
 */
export function el(tag, attributes = {}, ...children) {
  const made = SVG_TAGS.has(tag) ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === 'style') throw new Error('styles go by the style sheet');
    if (name === 'on') for (const [type, act] of Object.entries(value)) made.addEventListener(type, act);
    else if (name === 'data') Object.assign(made.dataset, value);
    else if (name === 'value' || name === 'checked' || name === 'disabled') made[name] = value;
    else made.setAttribute(name, value === true ? '' : value);
  }
  made.append(...children.flat(9).filter((child) => child !== null && child !== undefined && child !== false));
  return made;
}

/** A field with its label above it; the label holds the field, so that no id is needed. */
export function field(label, input, hint = null) {
  return el('label', { class: 'field' }, el('span', {}, label), input, hint && el('small', {}, hint));
}

/** A check box with its words. */
export function tick(label, attributes = {}) {
  return el('label', { class: 'tick' }, el('input', { type: 'checkbox', ...attributes }), el('span', {}, label));
}

/** A list of terms; a null among the pairs is left out. */
export function terms(...pairs) {
  return el('dl', { class: 'terms' }, pairs.filter(Boolean).map(([term, value]) => el('div', {}, el('dt', {}, term), el('dd', {}, value))));
}

/** A section with a heading that names it. */
let sections = 0;
export function section(title, { level = 2, cls = '' } = {}, ...children) {
  const id = `section-${++sections}`;
  return el('section', { class: `panel ${cls}`, 'aria-labelledby': id }, el(`h${level}`, { id }, title), ...children);
}
