// Light and dark: as the system has it, or as chosen here.
//
// Takes: the system's wish, and what was kept. Gives: `data-theme` on the root element.
// Does not know: colours; those are the style sheet's.

const KEY = 'outrigger-theme';
const system = matchMedia('(prefers-color-scheme: dark)');

/** The storage may be refused; then the system's wish holds. */
function kept() {
  try { return localStorage.getItem(KEY); } catch { return null; }
}

export function applyTheme() {
  const dark = kept() ? kept() === 'dark' : system.matches;
  document.documentElement.dataset.theme = dark ? 'dark' : 'light';
}

export function toggleTheme() {
  const other = document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark';
  try { localStorage.setItem(KEY, other); } catch { /* It holds until the page is left. */ }
  document.documentElement.dataset.theme = other;
}

system.addEventListener('change', applyTheme);
