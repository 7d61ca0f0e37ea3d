// Buttons that do something at the daemon.
//
// Takes: words and what to do. Gives: buttons that show that they are at it, tell failures, and ask in place before
// what cannot be taken back.
// Does not know: what they do.

import { el } from './dom.js';
import { W } from './words.js';
import { fail } from './notice.js';

/**
 * A button. While its work runs it is marked as busy and deaf, not disabled: a disabled button would lose the focus.
 * `key` lets the focus find it again when its part is drawn anew.
 */
export function button(label, act, { kind = '', key = label, disabled = false, type = 'button', ...attributes } = {}) {
  const made = el('button', { type, class: kind, disabled, data: { key }, ...attributes }, label);
  made.addEventListener('click', async () => {
    if (made.getAttribute('aria-busy') === 'true') return;
    made.setAttribute('aria-busy', 'true');
    try {
      await act(made);
    } catch (error) {
      fail(error);
    } finally {
      made.removeAttribute('aria-busy');
    }
  });
  return made;
}

/** A button that asks in its own place: the question, yes and no. Escape and no leave all as it was. */
export function asking(label, { question, yes, no = W.confirm.no, kind = 'danger', key = label }, act) {
  const place = el('span', { class: 'asking' });
  const rest = () => place.replaceChildren(first);
  const first = button(label, () => {
    const back = () => { rest(); first.focus(); };
    const refuse = button(no, back, { key: `${key} no` });
    const agree = button(yes, async () => { await act(); rest(); }, { kind, key: `${key} yes` });
    place.replaceChildren(el('span', {
      class: 'question', role: 'group', 'aria-label': question,
      on: { keydown: (event) => { if (event.key === 'Escape') { event.stopPropagation(); back(); } } },
    }, el('span', {}, question), agree, refuse));
    // The harmless answer has the focus, so that a second Enter does no harm.
    refuse.focus();
  }, { kind: kind === 'danger' ? 'risky' : kind, key });
  rest();
  return place;
}

/** A form whose submit goes to the daemon; its failure stands below its fields as well as it is read. */
export function form(fields, label, act, { kind = 'main', cls = 'stack' } = {}) {
  const problem = el('p', { class: 'form-problem', role: 'alert' });
  const submit = el('button', { type: 'submit', class: kind }, label);
  return el('form', {
    class: cls,
    on: {
      // What was wrong is not, once it is written anew.
      input: () => { problem.textContent = ''; },
      submit: async (event) => {
        event.preventDefault();
        if (submit.getAttribute('aria-busy') === 'true') return;
        submit.setAttribute('aria-busy', 'true');
        problem.textContent = '';
        try {
          await act(event.target);
        } catch (error) {
          problem.textContent = error.message;
        } finally {
          submit.removeAttribute('aria-busy');
        }
      },
    },
  }, fields, submit, problem);
}
