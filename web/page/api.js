// Speaks to the daemon.
//
// Takes: method, path, body. Gives: the answer's JSON, or throws a Problem in words. Asks for the password and sends
// again where the daemon wants it, renews a stale token, repeats what was lost on the way under the same idempotency key.
// Does not know: the page; how a password is asked for is told by `hooks`.

import { W } from './words.js';

const BASE = '/api/v2';
const TIMEOUT_MS = 20_000;
const REPEAT_AFTER_MS = 400;

/** The session as the daemon last told it. */
export const session = { user: null, csrf: null, needs_first_user: false, version: '' };

/** Set by the page: asks for the password (gives whether it was given), and hears that nobody is logged in any more. */
export const hooks = { password: async () => false, loggedOut: () => {} };

export class Problem extends Error {
  constructor(status, body = {}, retryAfter = null) {
    super(body.detail || body.title || W.problem.status(status));
    this.status = status;
    this.kind = String(body.type ?? '').split('/').pop();
    this.title = body.title || W.problem.title;
    this.retryAfter = retryAfter;
  }
}

export const may = (scope) => Boolean(session.user?.scopes.includes(scope));

/** A fresh key. `randomUUID` is missing where the page comes over plain HTTP, as it mostly does at home. */
export function freshKey() {
  if (crypto.randomUUID) return crypto.randomUUID();
  return [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, '0')).join('');
}

export async function problemOf(answer) {
  const body = await answer.json().catch(() => ({}));
  return new Problem(answer.status, body, answer.headers.get('Retry-After'));
}

async function once(method, path, body, key) {
  const headers = { Accept: 'application/json, application/problem+json' };
  if (body !== undefined) headers['Content-Type'] = 'application/json';
  if (method !== 'GET' && session.csrf) headers['X-Csrf-Token'] = session.csrf;
  if (method === 'POST') headers['Idempotency-Key'] = key;
  const ask = () => fetch(BASE + path, {
    method, headers, body: body === undefined ? undefined : JSON.stringify(body),
    credentials: 'same-origin', cache: 'no-store', signal: AbortSignal.timeout?.(TIMEOUT_MS),
  });
  try {
    return await ask();
  } catch {
    // With its key a POST is done once however often it comes, so it may be sent again.
    if (method === 'DELETE') throw new Problem(0, { title: W.problem.unreachable, detail: W.problem.unreachableTells });
  }
  await new Promise((done) => setTimeout(done, REPEAT_AFTER_MS));
  return ask().catch(() => { throw new Problem(0, { title: W.problem.unreachable, detail: W.problem.unreachableTells }); });
}

/** Asks the daemon. An answered request gets a new key when it is sent again: the old one would only repeat the answer. */
export async function call(method, path, body) {
  let passwords = 0;
  let tokens = 0;
  for (;;) {
    const answer = await once(method, path, body, freshKey());
    if (answer.ok) return answer.status === 204 ? null : answer.json().catch(() => null);
    const problem = await problemOf(answer);
    const aboutSession = path.startsWith('/session') || path === '/setup';
    if (problem.kind === 'reauthenticate' && passwords++ < 2 && await hooks.password()) continue;
    if (problem.kind === 'csrf' && tokens++ < 1) {
      await readSession();
      continue;
    }
    if (problem.status === 401 && !aboutSession) hooks.loggedOut();
    throw problem;
  }
}

export const get = (path) => call('GET', path);
export const post = (path, body = {}) => call('POST', path, body);
export const put = (path, body) => call('PUT', path, body);
export const remove = (path) => call('DELETE', path);

export const printerAction = (id, action, more = {}) => post(`/printers/${encodeURIComponent(id)}/actions`, { action, ...more });
export const jobAction = (id, action) => post(`/jobs/${encodeURIComponent(id)}/actions`, { action });

/** Who is asking, as the daemon sees it now. */
export async function readSession() {
  return Object.assign(session, await get('/session'));
}

export async function logIn(name, password) {
  await post('/session', { name, password });
  return readSession();
}

export async function setUp(code, name, password) {
  await post('/setup', { code, name, password });
  return readSession();
}

export async function logOut() {
  await remove('/session');
  return readSession();
}

/**
 * Sends a file's bytes as they are. `told` hears the fraction that is sent; `signal` gives it up. Fetch tells nothing of
 * what it has sent, so this goes by the older way.
 */
export function sendFile(file, printer, told, signal) {
  return new Promise((done, failed) => {
    const request = new XMLHttpRequest();
    const query = new URLSearchParams({ name: file.name, ...(printer ? { printer } : {}) });
    request.open('POST', `${BASE}/files?${query}`);
    request.responseType = 'json';
    request.setRequestHeader('Content-Type', 'application/octet-stream');
    request.setRequestHeader('Idempotency-Key', freshKey());
    if (session.csrf) request.setRequestHeader('X-Csrf-Token', session.csrf);
    request.upload.onprogress = (event) => told(event.lengthComputable ? event.loaded / event.total : null);
    request.onload = () => {
      if (request.status < 300) done(request.response);
      else failed(new Problem(request.status, request.response ?? {}, request.getResponseHeader('Retry-After')));
    };
    request.onerror = () => failed(new Problem(0, { title: W.problem.unreachable, detail: W.problem.uploadBroke }));
    request.onabort = () => failed(new Problem(0, { title: W.upload.givenUp }));
    signal.addEventListener('abort', () => request.abort());
    request.send(file);
  });
}
