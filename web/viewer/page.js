'use strict';
// What the pages share: what the page around them wishes, when they paint, and keys.

// A page that shows this one in a frame says `?theme=dark` or `light`: no storage is shared with it. What is chosen here
// goes before it; a page from a file is asked for by no such address.
const wished = new URLSearchParams(location.search).get('theme');
if (wished === 'dark' || wished === 'light') {
  const themeOf = theme;
  theme = (chosen) => themeOf(chosen ?? wished);
}

/** Paints before the next frame, once however often it is asked. */
function oncePerFrame(paint) {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => {
      asked = false;
      paint();
    });
  };
}

/** Acts on keys; a key that goes with another, or to one of `others`, is not ours. */
function onKeys(keys, others) {
  window.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (others && event.target.matches?.(others)) return;
    const act = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act();
  });
}
