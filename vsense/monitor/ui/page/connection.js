// The WebSocket: what comes goes to the store, what is pressed goes out; comes back by itself.

const RETRY_MS = [250, 500, 1000, 2000];
const GONE_MS = 6000;
const TELL_EVERY = 8;
const TELL_MS = 60;

/** One server, for as long as the page is open. */
export class Connection {
  /**
   * @param {(topic: string, timeNs: number, data: object, blob: Uint8Array|null) => void} take gets messages.
   * @param {() => object[]} greet what to say at the beginning of every connection.
   */
  constructor(take, greet) {
    this.open = false;
    this.since = performance.now();
    /** When the last frame came [ms]; the server says something every two seconds. */
    this.heard = performance.now();
    this.frames = 0;
    /** When an emergency stop was pressed that is not answered yet [ms], or null. */
    this.emergency = null;
    this.asked = this.answered = this.awaited = 0;
    this.take = take;
    this.greet = greet;
    this.told = 0;
    this.tries = 0;
    this.#connect();
    setInterval(() => this.open && performance.now() - this.heard > GONE_MS && this.#lose(this.socket), 1000);
  }

  /** Says something; tells whether it went out. */
  say(sentence) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(sentence));
    return true;
  }

  /** Sends an order; each gets one answer, in turn. */
  order(name, value, more = {}) {
    const sent = this.say({ order: name, value, ...more });
    if (sent) this.asked += 1;
    return sent;
  }

  /** The emergency stop goes out at once, and again with every new connection until it is answered. */
  stopAll() {
    this.emergency ??= performance.now();
    const sent = this.order("emergency", 1);
    this.awaited = this.asked;
    return sent;
  }

  #connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      Object.assign(this, { open: true, tries: 0, frames: 0, told: 0, asked: 0, answered: 0, heard: performance.now() });
      if (this.emergency !== null) this.stopAll();
      for (const sentence of this.greet()) this.say(sentence);
    };
    socket.onmessage = (event) => this.#hear(event.data);
    socket.onclose = () => this.#lose(socket);
  }

  // A dead network closes nothing: a socket that is silent for too long is left behind as it is.
  #lose(socket) {
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
    if (this.open) this.since = performance.now();
    this.open = false;
    const wait = RETRY_MS[Math.min(this.tries, RETRY_MS.length - 1)];
    this.tries += 1;
    setTimeout(() => this.#connect(), wait);
  }

  #hear(frame) {
    this.heard = performance.now();
    this.frames += 1;
    this.#tell();
    if (typeof frame === "string") {
      const [topic, timeNs, data] = JSON.parse(frame);
      // Changes of the world are answered when a timestep comes: they have no turn.
      if (topic === "/answer" && !data.change) this.#answer(data.ok);
      this.take(topic, timeNs, data, null);
      return;
    }
    const length = new DataView(frame).getUint32(0);
    const [topic, timeNs, data] = JSON.parse(new TextDecoder().decode(new Uint8Array(frame, 4, length)));
    this.take(topic, timeNs, data, new Uint8Array(frame, 4 + length));
  }

  // An emergency stop that was refused is still asked for.
  #answer(ok) {
    this.answered += 1;
    if (ok && this.answered >= this.awaited) this.emergency = null;
  }

  // The server keeps only so many frames on their way; the rest waits where newer ones replace it.
  #tell() {
    if (this.frames - this.told >= TELL_EVERY) this.#got();
    else this.telling ??= setTimeout(() => this.#got(), TELL_MS);
  }

  #got() {
    clearTimeout(this.telling);
    this.telling = undefined;
    this.told = this.frames;
    this.say({ got: this.frames });
  }
}
