// Light and dark: as the system has it, or as chosen here.
//
// Takes: the system's wish, and what was kept. Gives: `data-theme` on the root element, and the event `outrigger-theme`
// for what the style sheet does not reach.
// Does not know: colours; those are the style sheet's.

const KEY = 'outrigger-theme';
const system = matchMedia('(prefers-color-scheme: dark)');

/** The storage may be refused; then the system's wish holds. */
function kept() {
  try { return localStorage.getItem(KEY); } catch { return null; }
}

export const theme = () => document.documentElement.dataset.theme;

function set(wanted) {
  if (theme() === wanted) return;
  document.documentElement.dataset.theme = wanted;
  dispatchEvent(new Event('outrigger-theme'));
}

export function applyTheme() {
  const dark = kept() ? kept() === 'dark' : system.matches;
  set(dark ? 'dark' : 'light');
}

export function toggleTheme() {
  const other = theme() === 'dark' ? 'light' : 'dark';
  try { localStorage.setItem(KEY, other); } catch { /* It holds until the page is left. */ }
  set(other);
}

system.addEventListener('change', applyTheme);
