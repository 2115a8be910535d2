// SPDX-License-Identifier: Apache-2.0
/**
 * The WebSocket: connects by itself, again and again, and brings answers to who has asked.
 * @module
 */
import { decode, Type } from "./protocol.js";

const FIRST_RETRY_MS = 400;
const LAST_RETRY_MS = 5000;
const PING_PERIOD_MS = 5000;
const ANSWER_TIMEOUT_MS = 20000;
/** An edit of a large map, which is examined and saved, takes longer. */
const EDIT_TIMEOUT_MS = 300000;
const EDITS = new Set(["drop_closure", "undo_edit", "redo_edit"]);
/** A connection that takes longer to be made is given up. */
const OPEN_TIMEOUT_MS = 8000;
const ANSWERS = new Set([Type.CLOSURE, Type.CLOSURES, Type.PROBLEM, Type.PONG, Type.EDITED,
  Type.GIVEN]);

/** @typedef {"connected" | "lost" | "silent"} Status silent: the other side may be out of reach */

/** Return where the server is, with the token of the page's own address. */
export function socketUrl() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  return `${scheme}//${location.host}/socket${location.search}`;
}

/** A connection that is made again whenever it is lost. */
export class Connection {
  /**
   * @param {string} url of the WebSocket
   * @param {object} handlers
   * @param {() => void} handlers.onOpen a new connection: what was known is void
   * @param {(message: {type: number}) => void} handlers.onMessage
   * @param {(status: Status) => void} handlers.onStatus
   */
  constructor(url, handlers) {
    this.url = url;
    this.handlers = handlers;
    /** Bytes received over this connection. */
    this.bytes = 0;
    this.retryMs = FIRST_RETRY_MS;
    /** @type {WebSocket | null} */
    this.socket = null;
    this.nextId = 1;
    /** @type {Map<number, {resolve: Function, reject: Function}>} */
    this.asked = new Map();
    this.stopped = false;
    /** Whether an answer to a ping is awaited, and when anything came last [ms]. */
    this.isPinging = false;
    this.heardAt = 0;
    this.isSilent = false;
    setInterval(() => this.ping(), PING_PERIOD_MS);
    addEventListener("online", () => this.retryNow());
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden) this.retryNow();
    });
    this.open();
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Connect, forgetting any connection that there is. */
  open() {
    clearTimeout(this.timer);
    this.socket?.close();
    this.forget();
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.bytes = 0;
    this.timer = setTimeout(() => socket.close(), OPEN_TIMEOUT_MS);
    socket.onopen = () => {
      if (socket !== this.socket) return;
      clearTimeout(this.timer);
      this.heardAt = performance.now();
      this.retryMs = FIRST_RETRY_MS;
      this.handlers.onOpen();
      this.handlers.onStatus("connected");
    };
    socket.onmessage = (event) => {
      if (socket === this.socket) this.receive(event.data);
    };
    socket.onclose = () => {
      if (socket === this.socket) this.lose();
    };
  }

  /** Stop for good: the server speaks another language. */
  stop() {
    this.stopped = true;
    this.socket?.close();
  }

  retryNow() {
    if (!this.stopped && this.socket?.readyState === WebSocket.CLOSED) this.open();
  }

  /** Nobody will answer any more. */
  forget() {
    for (const { reject } of this.asked.values()) reject(new Error("The connection was lost."));
    this.asked.clear();
    this.isPinging = this.isSilent = false;
  }

  lose() {
    clearTimeout(this.timer);
    this.forget();
    if (this.stopped) return;
    this.handlers.onStatus("lost");
    this.timer = setTimeout(() => this.open(), this.retryMs);
    this.retryMs = Math.min(2 * this.retryMs, LAST_RETRY_MS);
  }

  /** @param {ArrayBuffer} data */
  receive(data) {
    this.bytes += data.byteLength;
    this.heardAt = performance.now();
    if (this.isSilent) {
      this.isSilent = false;
      this.handlers.onStatus("connected");
    }
    let id = null; // of the request that the next message answers
    for (const message of decode(data)) {
      if (message.type === Type.ANSWER) {
        id = message.content.id;
      } else if (id !== null || ANSWERS.has(message.type)) {
        this.answer(id ?? message.content.id, message);
        id = null;
      } else {
        this.handlers.onMessage(message);
      }
    }
  }

  /** Give a message to who has asked for it. */
  answer(id, message) {
    const waiting = this.asked.get(id);
    if (!waiting) return;
    this.asked.delete(id);
    if (message.type === Type.PROBLEM) waiting.reject(new Error(message.content.text));
    else waiting.resolve(message);
  }

  /**
   * Send a request that is answered by the state itself.
   * @param {object} request
   */
  send(request) {
    if (this.isOpen) this.socket.send(JSON.stringify(request));
  }

  /**
   * Send a request, and return its answer.
   * @param {object} request without its id
   * @returns {Promise<any>}
   */
  ask(request) {
    if (!this.isOpen) return Promise.reject(new Error("There is no connection to the program."));
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.asked.set(id, { resolve, reject });
      this.send({ ...request, id });
      setTimeout(() => {
        if (this.asked.delete(id)) reject(new Error("The program does not answer."));
      }, EDITS.has(request.type) ? EDIT_TIMEOUT_MS : ANSWER_TIMEOUT_MS);
    });
  }

  /**
   * Make sure that the other side is there: a laptop that slept, and a tablet that was carried out of
   * reach, notice only so.
   */
  ping() {
    if (!this.isOpen || document.hidden) return;
    const socket = this.socket;
    if (this.isPinging && !this.isSilent && performance.now() - this.heardAt > PING_PERIOD_MS) {
      this.isSilent = true;
      this.handlers.onStatus("silent");
    }
    if (this.isPinging) return;
    this.isPinging = true;
    this.ask({ type: "ping" }).then(() => {
      this.isPinging = false;
    }, () => {
      if (socket !== this.socket || !this.isOpen) return;
      this.handlers.onStatus("lost");
      this.open();
    });
  }
}
