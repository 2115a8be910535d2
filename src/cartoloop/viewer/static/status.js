// SPDX-License-Identifier: Apache-2.0
/**
 * How it stands, in plain words: what the program does, whether there is a connection to it, and
 * whether this browser can show anything.
 * @module
 */
import { byId, setText } from "./dom.js";

/** A connection that is back sooner is not worth a word. */
const PATIENCE_MS = 700;
/** A program that reads its map answers later: its saved picture is shown meanwhile. */
const READING_MS = 30000;
/** Time for the graphics card to come back [ms]. */
const GRAPHICS_MS = 5000;

const LOST = "No connection to the program. The map stays as it was; this page tries again by itself.";
const NEVER = "The program cannot be reached. Is it still running? This page tries again by itself.";

/** Shows the state of the run and of the connection. */
export class Status {
  constructor() {
    this.dot = byId("state-dot");
    this.text = byId("state");
    this.empty = byId("empty");
    this.banner = byId("banner");
    this.hasFailed = false;
  }

  /**
   * @param {import("./connection.js").Status} connection
   * @param {{state: string, text: string} | null} readings the last that came
   */
  show(connection, readings) {
    if (this.hasFailed) return;
    clearTimeout(this.timer);
    document.body.dataset.connection = connection;
    if (connection === "connected") {
      this.setBanner("");
      this.say(readings?.state ?? "starting", readings?.text ?? "loading the map");
      return;
    }
    if (connection === "silent") {
      this.say("lost", "no answer from the program");
      return;
    }
    this.say("lost", readings ? "reconnecting" : "connecting");
    const patience = document.getElementById("opening") ? READING_MS : PATIENCE_MS;
    this.timer = setTimeout(() => this.setBanner(readings ? LOST : NEVER), patience);
  }

  /** Nothing more can be shown. @param {string} text why */
  fail(text) {
    clearTimeout(this.timer);
    this.hasFailed = true;
    document.body.dataset.connection = "failed";
    this.say("failed", "the map cannot be shown");
    this.setBanner(text);
  }

  /** Watch over the graphics card: all that it held is gone when it is lost. */
  watch(canvas) {
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.setBanner("The graphics card was lost. The page is loaded again as soon as it is back.");
      setTimeout(() => location.reload(), GRAPHICS_MS);
    });
    canvas.addEventListener("webglcontextrestored", () => location.reload());
  }

  say(state, text) {
    this.dot.dataset.state = state;
    setText(this.text, text);
    this.empty.dataset.text = text;
  }

  setBanner(text) {
    this.banner.hidden = text === "";
    setText(this.banner, text);
  }
}
