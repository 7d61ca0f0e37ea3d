'use strict';
// What the pages share: when they paint, and keys.

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
