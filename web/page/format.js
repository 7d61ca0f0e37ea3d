// Numbers, times and sizes for people.
//
// Takes: numbers in the units of the API. Gives: short texts.
// Does not know: where they stand; words around them are of words.js.

import { W } from './words.js';

const NONE = W.none;
const known = (value) => value !== null && value !== undefined && Number.isFinite(value);

/** A fixed number of digits; −0 is 0, and minus is a minus. */
export function number(value, digits = 0) {
  if (!known(value)) return NONE;
  // Groups of three, from five digits on, by a narrow space that does not break.
  const text = value.toFixed(digits).replace(/^-?\d{5,}/, (whole) => whole.replace(/\B(?=(\d{3})+$)/g, '\u202f'));
  return (/^-0\.?0*$/.test(text) ? text.slice(1) : text).replace('-', '−');
}

export const mm = (value, digits = 2) => (known(value) ? `${number(value, digits)} mm` : NONE);
export const celsius = (value, digits = 0) => (known(value) ? `${number(value, digits)} °C` : NONE);

/** 215 / 220 °C, or one of them where nothing is aimed at. */
export function heater(one) {
  if (!one || !known(one.actual_c)) return NONE;
  return one.target_c > 0 ? `${number(one.actual_c)} / ${number(one.target_c)} °C` : celsius(one.actual_c);
}

export function percent(fraction) {
  if (!known(fraction)) return NONE;
  // A job that has a line to go is not at 100 %.
  return `${fraction >= 1 ? 100 : Math.min(99, Math.floor(fraction * 100))} %`;
}

export function bytes(value) {
  if (!known(value)) return NONE;
  const units = W.units.bytes;
  let step = 0;
  let left = value;
  while (left >= 1000 && step < units.length - 1) {
    left /= 1000;
    step += 1;
  }
  return `${number(left, step === 0 || left >= 100 ? 0 : 1)} ${units[step]}`;
}

/** 2 h 05 min, 12 min, 40 s. */
export function span(seconds) {
  if (!known(seconds)) return NONE;
  const whole = Math.max(0, Math.round(seconds));
  if (whole < 60) return W.units.seconds(whole);
  const minutes = Math.round(whole / 60);
  if (minutes < 60) return W.units.minutes(minutes);
  const hours = Math.floor(minutes / 60);
  if (hours < 48) return W.units.hours(hours, String(minutes % 60).padStart(2, '0'));
  return W.units.days(Math.floor(hours / 24), hours % 24);
}

const sameDay = (a, b) => a.toDateString() === b.toDateString();

export function clock(date, withSeconds = false) {
  return date.toLocaleTimeString([], { hour: '2-digit', minute: '2-digit', hourCycle: 'h23', ...(withSeconds ? { second: '2-digit' } : {}) });
}

/** A time of day, with the date when it is not today's. */
export function when(unixS) {
  if (!known(unixS)) return NONE;
  const date = new Date(unixS * 1000);
  const now = new Date();
  if (sameDay(date, now)) return clock(date);
  const day = date.toLocaleDateString([], { day: 'numeric', month: 'short', ...(date.getFullYear() === now.getFullYear() ? {} : { year: 'numeric' }) });
  return `${day}, ${clock(date)}`;
}

/** Words of the daemon, as a sentence of their own begins. */
export const sentence = (words) => (words ? words[0].toUpperCase() + words.slice(1) : '');

/** When it ends, if it goes on as it goes: to the minute, so that it does not tremble. */
export function endsAt(leftS) {
  return known(leftS) ? when(Math.round((Date.now() / 1000 + leftS) / 60) * 60) : NONE;
}
