// The way of a job, step by step, with where it is now.
//
// Takes: a job's id. Gives: a list of steps: done, now, to come.
// Does not know: times that the daemon does not tell; those steps stand without one.

import { el, section } from './dom.js';
import { W } from './words.js';
import { store } from './live.js';
import { span, when } from './format.js';

// Which step a state belongs to.
const STEP_OF = {
  checking: 'checked', held: 'decided', mending: 'mended', mended: 'decided', queued: 'queued',
  finished: 'ended', cancelled: 'ended', failed: 'ended',
};

function stepsOf(job) {
  const decided = ['held', 'mended', 'mending'].includes(job.state) || job.mend;
  const names = ['accepted', 'checked', ...(job.mend || job.state === 'mending' ? ['mended'] : []), ...(decided ? ['decided'] : []), 'queued', 'printed', 'ended'];
  const at = names.indexOf(STEP_OF[job.state] ?? 'printed');
  const over = job.state === 'finished' || job.state === 'cancelled' || job.state === 'failed';
  const time = { accepted: job.created_unix_s, printed: job.started_unix_s, ended: job.ended_unix_s };
  return names.map((name, k) => {
    // A job that ended before it was printed never was in the steps between.
    const skipped = over && !job.started_unix_s && ['queued', 'printed'].includes(name);
    const state = skipped ? 'left' : k < at || over ? 'done' : k === at ? 'now' : 'next';
    const last = name === 'ended' && over;
    const took = last && job.started_unix_s && job.ended_unix_s ? W.job.took(span(job.ended_unix_s - job.started_unix_s)) : '';
    return { words: last ? W.jobState[job.state][0] : W.job.steps[name], state: last && job.state !== 'finished' ? 'bad' : state, time: state === 'next' ? null : time[name] ?? null, took };
  }).filter(({ state }) => state !== 'left');
}

export function timeline(scope, id) {
  return section(W.job.timeline, {}, scope.part(() => (store.jobs.has(id) ? stepsOf(store.jobs.get(id)) : []), (steps) => el('ol', { class: 'timeline' },
    steps.map(({ words, state, time, took }) => el('li', { class: state, 'aria-current': state === 'now' ? 'step' : null },
      el('span', {}, words), el('span', { class: 'faint' }, [state === 'now' && !time ? W.job.now : time && when(time), took].filter(Boolean).join(' · ')))))));
}
