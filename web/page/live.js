// What the daemon tells of itself, kept as it comes.
//
// Takes: the events of the WebSocket. Gives: printers, jobs, files and key requests as maps, whether the connection
// lives, and who wants to hear of changes. Connects again by itself, waiting longer each time.
// Does not know: how any of it is shown, nor how to act on it.

const WAITS_MS = [500, 1000, 2000, 4000, 8000, 15_000];
// A dead network closes no socket. A daemon that was silent for so long is asked, and given up if it does not answer.
const SILENCE_MS = 20_000;
const ANSWER_MS = 6_000;
// Changes that come together are drawn together.
const GATHER_MS = 40;

class Store {
  constructor() {
    this.printers = new Map();
    this.jobs = new Map();
    this.files = new Map();
    this.requests = new Map();
    this.selected = null; // the printer that is being looked at
    this.connection = 'connecting'; // connecting, live, lost
    this.told = false; // whether anything is known at all
    this.heardMs = 0;
    this.listeners = new Set();
    this.streams = { temperatures: new Set(), console: new Set() };
    this.gathering = null;
  }

  subscribe(listener) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  /** Hears each message of a stream (`temperatures`, `console`); gives what ends it. */
  stream(name, listener) {
    this.streams[name].add(listener);
    return () => this.streams[name].delete(listener);
  }

  changed() {
    this.gathering ??= setTimeout(() => {
      this.gathering = null;
      for (const listener of [...this.listeners]) if (this.listeners.has(listener)) listener();
    }, GATHER_MS);
  }

  get stale() {
    return this.connection !== 'live';
  }

  clear() {
    for (const map of [this.printers, this.jobs, this.files, this.requests]) map.clear();
    this.told = false;
    this.selected = null;
  }
}

export const store = new Store();

const byId = (list) => new Map(list.map((one) => [one.id, one]));

/** One message into the store. Kinds that this page does not know are of a newer daemon and left alone. */
export function take(message) {
  store.heardMs = Date.now();
  switch (message.type) {
    case 'hello':
      store.printers = byId(message.printers);
      store.jobs = byId(message.jobs);
      store.files = byId(message.files);
      store.told = true;
      store.connection = 'live';
      break;
    case 'printer': store.printers.set(message.printer.id, message.printer); break;
    case 'job': store.jobs.set(message.job.id, message.job); break;
    case 'file': store.files.set(message.file.id, message.file); break;
    case 'gone': (message.what === 'job' ? store.jobs : store.files).delete(message.id); break;
    case 'key_request': store.requests.set(message.id, { id: message.id, app: message.app }); break;
    case 'key_answered': store.requests.delete(message.id); break;
    case 'temperatures':
    case 'console':
      for (const listener of store.streams[message.type]) listener(message);
      if (message.type === 'console') return;
      warm(message);
      break;
    default: return;
  }
  store.changed();
}

/** A sample is newer than what its printer last told. */
function warm({ printer: id, sample: [, nozzle, nozzleTarget, bed, bedTarget] }) {
  const printer = store.printers.get(id);
  if (!printer) return;
  const heater = (actual, target) => (actual === null || actual === undefined ? null : { actual_c: actual, target_c: target ?? 0 });
  const temperatures = {
    ...printer.temperatures,
    nozzle: heater(nozzle, nozzleTarget) ?? printer.temperatures?.nozzle ?? null,
    bed: heater(bed, bedTarget) ?? printer.temperatures?.bed ?? null,
  };
  store.printers.set(id, { ...printer, temperatures });
}

/** The connection, and all that keeps it. `whoNow` is asked when it could not be made: maybe nobody is logged in. */
export class Live {
  constructor(whoNow) {
    this.whoNow = whoNow;
    this.tries = 0;
    this.socket = null;
    this.ended = false;
    this.wake = () => { if (document.visibilityState === 'visible' && store.stale) this.soon(0); };
    addEventListener('online', this.wake);
    document.addEventListener('visibilitychange', this.wake);
    this.watchdog = setInterval(() => this.listen(), 5000);
    this.connect();
  }

  connect() {
    clearTimeout(this.timer);
    this.timer = null;
    if (this.ended) return;
    this.drop();
    const socket = new WebSocket(`${location.protocol === 'https:' ? 'wss' : 'ws'}://${location.host}/api/v2/events`);
    this.socket = socket;
    socket.onmessage = (event) => {
      this.tries = 0;
      take(JSON.parse(event.data));
    };
    socket.onclose = () => { if (this.socket === socket) this.lost(); };
  }

  /** Lets go of the socket without waiting for its close, which on a dead network takes minutes. */
  drop() {
    const socket = this.socket;
    this.socket = null;
    if (!socket) return;
    socket.onmessage = socket.onclose = null;
    socket.close();
  }

  async lost() {
    this.drop();
    store.connection = 'lost';
    store.changed();
    const wait = WAITS_MS[Math.min(this.tries++, WAITS_MS.length - 1)];
    // Pages that lost the same daemon shall not all come back at once.
    this.soon(wait * (0.75 + Math.random() / 2));
    if (this.tries % 2 === 0) await this.whoNow().catch(() => {});
  }

  soon(ms) {
    if (this.ended) return;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.connect(), ms);
  }

  async listen() {
    if (store.connection !== 'live' || this.asking || Date.now() - store.heardMs < SILENCE_MS) return;
    this.asking = true;
    try {
      const answer = fetch('/api/v2/session', { cache: 'no-store' });
      await Promise.race([answer, new Promise((_, late) => setTimeout(() => late(new Error('late')), ANSWER_MS))]);
      store.heardMs = Date.now();
    } catch {
      this.lost();
    } finally {
      this.asking = false;
    }
  }

  end() {
    this.ended = true;
    clearTimeout(this.timer);
    clearInterval(this.watchdog);
    removeEventListener('online', this.wake);
    document.removeEventListener('visibilitychange', this.wake);
    this.drop();
    store.connection = 'connecting';
  }
}
