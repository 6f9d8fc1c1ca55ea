// The WebSocket: what comes goes to the store, what is pressed goes out; comes back by itself.

const RETRY_MS = [250, 500, 1000, 2000];
const GONE_MS = 6000;
const CONNECT_MS = 3000;
const RECEIPT_EVERY = 8;
const RECEIPT_MS = 60;

/** One server, for as long as the page is open. */
export class Connection {
  open = false;
  since = performance.now();
  /** When the last frame came [ms]; the server says something every two seconds. */
  heard = performance.now();
  frames = 0;
  /** When an emergency stop was pressed that is not answered yet [ms].
   * @type {number | null} */
  emergency = null;
  /** Why it was refused the last time. */
  refusal = "";
  /** @type {WebSocket | undefined} */
  socket;
  /** Orders that are not answered yet, in turn.
   * @type {string[]} */
  #asked = [];
  #tries = 0;
  /** Frames that the server knows of. */
  #receipted = 0;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;

  /**
   * @param {(topic: string, timeNs: number, data: any, blob: Uint8Array | null) => void} take gets messages.
   * @param {() => Sentence[]} greeting what to say at the beginning of every connection.
   */
  constructor(take, greeting) {
    this.take = take;
    this.greeting = greeting;
    this.#connect();
    setInterval(() => this.#checkUp(), 1000);
  }

  /** Says something; gives whether it went out.
   * @param {Sentence} sentence */
  say(sentence) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(sentence));
    return true;
  }

  /** Sends an order; each gets one answer, in turn.
   * @param {string} name @param {number} value @param {{ pair?: Point }} more */
  order(name, value, more = {}) {
    const sent = this.say({ order: name, value, ...more });
    if (sent) this.#asked.push(name);
    return sent;
  }

  /** The emergency stop goes out at once, and again with every new connection and refusal until it is taken. */
  stopAll() {
    this.emergency ??= performance.now();
    return this.order("emergency", 1);
  }

  #connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => this.#begin();
    socket.onmessage = (event) => this.#receive(event.data);
    socket.onclose = () => this.#lose(socket);
    // What a dead network swallowed stays on its way for minutes, also when the network is back.
    setTimeout(() => socket.readyState === WebSocket.CONNECTING && this.#lose(socket), CONNECT_MS);
  }

  #begin() {
    this.open = true;
    this.heard = performance.now();
    this.frames = this.#receipted = this.#tries = 0;
    this.#asked = [];
    if (this.emergency !== null) this.stopAll();
    for (const sentence of this.greeting()) this.say(sentence);
  }

  #checkUp() {
    if (!this.socket || !this.open) return;
    if (performance.now() - this.heard > GONE_MS) this.#lose(this.socket);
    else if (this.emergency !== null && !this.#asked.includes("emergency")) this.stopAll();
  }

  /** A dead network closes nothing: a socket that is silent for too long is left behind as it is.
   * @param {WebSocket} socket */
  #lose(socket) {
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
    if (this.open) this.since = performance.now();
    this.open = false;
    const wait = RETRY_MS[this.emergency === null ? Math.min(this.#tries, RETRY_MS.length - 1) : 0];
    this.#tries += 1;
    setTimeout(() => this.#connect(), wait);
  }

  /** @param {string | ArrayBuffer} frame */
  #receive(frame) {
    this.heard = performance.now();
    this.frames += 1;
    this.#scheduleReceipt();
    if (typeof frame === "string") {
      const [topic, timeNs, data] = JSON.parse(frame);
      // Changes of the world are answered when a timestep comes: they have no turn.
      if (topic === "/answer" && !data.change && this.#takeAnswer(data)) return;
      this.take(topic, timeNs, data, null);
      return;
    }
    const length = new DataView(frame).getUint32(0);
    const [topic, timeNs, data] = JSON.parse(new TextDecoder().decode(new Uint8Array(frame, 4, length)));
    this.take(topic, timeNs, data, new Uint8Array(frame, 4 + length));
  }

  /** An emergency stop that was refused is still asked for; gives whether the answer says nothing new.
   * @param {AnswerMessage} answer */
  #takeAnswer({ ok, text }) {
    if (this.#asked.shift() !== "emergency" || this.emergency === null) return false;
    if (ok && !this.#asked.includes("emergency")) this.emergency = null;
    const isKnown = !ok && text === this.refusal;
    this.refusal = ok ? "" : text;
    return isKnown;
  }

  // The server keeps only so many frames on their way; the rest waits where newer ones replace it.
  #scheduleReceipt() {
    if (this.frames - this.#receipted >= RECEIPT_EVERY) this.#sendReceipt();
    else this.#timer ??= setTimeout(() => this.#sendReceipt(), RECEIPT_MS);
  }

  #sendReceipt() {
    clearTimeout(this.#timer);
    this.#timer = undefined;
    this.#receipted = this.frames;
    this.say({ got: this.frames });
  }
}
