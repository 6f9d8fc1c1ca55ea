// The WebSocket: what comes goes to the store, what is pressed goes out; comes back by itself.

const RETRY_MS = [250, 500, 1000, 2000];
const GONE_MS = 4000;
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
    /** When the last frame came [ms]; a silent server is as good as none. */
    this.heard = performance.now();
    this.frames = 0;
    this.emergency = false;
    this.take = take;
    this.greet = greet;
    this.told = 0;
    this.tries = 0;
    this.#connect();
  }

  /** Whether the server is there but has said nothing for so long that people must be told. */
  get silent() {
    return this.open && performance.now() - this.heard > GONE_MS;
  }

  /** Says something; tells whether it went out. */
  say(sentence) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(sentence));
    return true;
  }

  /** The emergency stop goes out at once, or as soon as there is a connection again. */
  stopAll() {
    this.emergency = !this.say({ order: "emergency", value: 1 });
    return !this.emergency;
  }

  #connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      Object.assign(this, { open: true, tries: 0, frames: 0, told: 0, heard: performance.now() });
      for (const sentence of this.greet()) this.say(sentence);
      if (this.emergency) this.stopAll();
    };
    socket.onmessage = (event) => this.#hear(event.data);
    socket.onclose = () => {
      if (this.open) this.since = performance.now();
      this.open = false;
      const wait = RETRY_MS[Math.min(this.tries, RETRY_MS.length - 1)];
      this.tries += 1;
      setTimeout(() => this.#connect(), wait);
    };
  }

  #hear(frame) {
    this.heard = performance.now();
    this.frames += 1;
    this.#tell();
    if (typeof frame === "string") {
      const [topic, timeNs, data] = JSON.parse(frame);
      this.take(topic, timeNs, data, null);
      return;
    }
    const length = new DataView(frame).getUint32(0);
    const [topic, timeNs, data] = JSON.parse(new TextDecoder().decode(new Uint8Array(frame, 4, length)));
    this.take(topic, timeNs, data, new Uint8Array(frame, 4 + length));
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
