// The pictures of a job: as sliced, mended, and the paths before and after.
//
// Takes: a job's id. Gives: a panel with the viewer's page in a frame of its own, which may run its scripts and reach
// nothing of this page, and a choice where there is more than one picture.
// Does not know: what the viewer shows.

import { el, section } from './dom.js';
import { W } from './words.js';
import { store } from './live.js';
import { theme } from './theme.js';

/** Only the daemon's own addresses are shown: what came from elsewhere could be anybody's page. */
const own = (url) => (typeof url === 'string' && url.startsWith('/api/v2/') ? url : null);

function picturesOf(id) {
  const job = store.jobs.get(id);
  if (!job) return [];
  const layers = own(store.files.get(job.file)?.checks?.[job.printer]?.picture);
  const mended = job.mend?.state === 'done' ? own(job.mend.picture) : null;
  const paths = job.mend?.state === 'done' ? own(job.mend.paths_picture) : null;
  return [
    mended && { url: mended, name: W.job.after, title: W.job.mendedOf(job.name), frame: true },
    layers && { url: layers, name: W.job.before, title: W.job.pictureOf(job.name), frame: true },
    paths && { url: paths, name: W.job.paths, title: W.job.pathsAlt(job.name), frame: false },
  ].filter(Boolean);
}

/** A page of the viewer, told whether to be light or dark: it sees neither this page nor what was chosen on it. */
const themed = (url) => `${url}${url.includes('?') ? '&' : '?'}theme=${theme()}`;

function shown({ url: plain, title, frame }) {
  const url = frame ? themed(plain) : plain;
  const picture = frame
    ? el('iframe', { src: url, title, sandbox: 'allow-scripts', loading: 'lazy', referrerpolicy: 'no-referrer' })
    : el('div', { class: 'paths' }, el('img', { src: url, alt: title, loading: 'lazy' }));
  return [picture, el('p', {}, el('a', { href: url, target: '_blank', rel: 'noopener', data: { key: 'tab' } }, W.job.ownTab))];
}

export function picturePanel(scope, id) {
  let chosen = 0;
  // The frame is drawn anew only when there are other pictures, or it would load and lose its view with each word.
  return section(W.job.picture, { cls: 'picture' }, scope.part(() => picturesOf(id), (pictures, inner) => {
    if (!pictures.length) return el('p', { class: 'faint' }, W.job.pictureNone);
    chosen = 0;
    const place = el('div', {});
    const choose = (k) => {
      chosen = k;
      place.replaceChildren(...shown(pictures[k]));
    };
    choose(chosen);
    inner.on(window, 'outrigger-theme', () => { if (pictures[chosen].frame) choose(chosen); });
    const choice = el('div', { class: 'segments', role: 'radiogroup', 'aria-label': W.job.whichPicture }, pictures.map(({ name }, k) => el('label', {},
      el('input', { type: 'radio', name: `picture-${id}`, checked: k === chosen, on: { change: () => choose(k) } }), el('span', {}, name))));
    return [pictures.length > 1 && choice, place];
  }));
}
