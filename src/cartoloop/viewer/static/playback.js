// SPDX-License-Identifier: Apache-2.0
/**
 * Time: pause and pace of a recording that is being mapped; and of a finished map, its growth.
 * @module
 */
import { byId, setText } from "./dom.js";
import { duration } from "./words.js";

const SPEEDS = [1, 2, 5, 10, 30, 100];
const SPEEDS_AGAIN = [1, 5, 20, 60, 200];
const SCRUB_STEPS = 1000;
/** Shortest time between two requests for scans of nodes [ms]. */
const SCAN_PERIOD_MS = 120;

/** The bar of time. */
export class PlaybackBar {
  /**
   * @param {object} hooks
   * @param {(request: object) => Promise<any>} hooks.ask the server
   * @param {(request: object) => void} hooks.send
   * @param {import("./state.js").MapState} hooks.state
   * @param {() => void} hooks.onChange another time is shown
   */
  constructor(hooks) {
    this.hooks = hooks;
    /** Time that is shown [s]; null: all. @type {number | null} */
    this.time = null;
    this.isPlaying = false;
    this.isScrubbing = false;
    this.speed = 60;
    /** Scan of the node that is shown. @type {import("./protocol.js").Scan | null} */
    this.scan = null;
    this.root = byId("playback");
    this.play = byId("play");
    this.scrub = byId("scrub");
    this.select = byId("speed");
    this.play.addEventListener("click", () => this.toggle());
    this.scrub.addEventListener("input", () => this.scrubTo(Number(this.scrub.value) / SCRUB_STEPS));
    // Some browsers report no change where a drag ends at its first value.
    for (const end of ["change", "pointerup", "pointercancel", "blur"]) {
      this.scrub.addEventListener(end, () => this.endScrubbing());
    }
    this.select.addEventListener("change", () => this.setSpeed());
  }

  /** Forget: a connection begins. */
  begin() {
    this.time = null;
    this.scan = null;
    this.isPlaying = false;
    this.isScrubbing = false;
    this.choices = null;
  }

  /** Whether the past of a finished map is shown. */
  get isBack() {
    return this.time !== null;
  }

  get span() {
    const { rows } = this.hooks.state.times;
    return rows.length > 1 ? [rows[0], rows[rows.length - 1]] : null;
  }

  /** How many nodes are to be shown. */
  get numNodes() {
    const { nodes, times } = this.hooks.state;
    if (this.time === null) return nodes.length;
    const { rows } = times;
    let [low, high] = [0, rows.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (rows[middle] <= this.time) low = middle + 1;
      else high = middle;
    }
    return Math.min(low, nodes.length);
  }

  toggle() {
    const { state, send, onChange } = this.hooks;
    if (!state.playback) return;
    if (state.playback.can_pause) {
      send({ type: state.playback.paused ? "play" : "pause" });
    } else if (state.playback.can_scrub && this.span) {
      this.isPlaying = !this.isPlaying;
      if (this.isPlaying && this.time === null) [this.time] = this.span;
      this.last = performance.now();
      this.show();
      onChange();
    }
  }

  scrubTo(share) {
    if (!this.span) return;
    const [begin, end] = this.span;
    this.isScrubbing = true;
    this.time = share >= 1 ? null : begin + share * (end - begin);
    if (this.time === null) {
      this.scan = null;
      this.isPlaying = false;
    }
    this.show();
    this.hooks.onChange();
  }

  endScrubbing() {
    if (!this.isScrubbing) return;
    this.isScrubbing = false;
    this.hooks.onChange();
  }

  /** Let time pass; return whether it does. */
  advance(now) {
    if (!this.isPlaying || this.time === null) return false;
    this.time += Math.min((now - this.last) / 1000, 0.5) * this.speed;
    this.last = now;
    if (this.time >= this.span[1]) {
      this.time = null;
      this.scan = null;
      this.isPlaying = false;
    }
    this.show();
    return true;
  }

  setSpeed() {
    const value = this.select.value === "" ? null : Number(this.select.value);
    if (this.hooks.state.playback?.can_set_speed) this.hooks.send({ type: "speed", value });
    else this.speed = value ?? 60;
  }

  /** Bring the bar up to date with the state. */
  show() {
    const { playback, readings } = this.hooks.state;
    if (!playback) return;
    const canPlay = playback.can_pause || (playback.can_scrub && this.span !== null);
    this.root.hidden = !canPlay;
    if (!canPlay) return;
    const speed = playback.can_set_speed ? playback.speed : this.speed;
    this.offer(playback.can_set_speed ? [null, ...withSpeed(SPEEDS, speed)] : SPEEDS_AGAIN);
    if (document.activeElement !== this.select) this.select.value = speed === null ? "" : String(speed);
    const isPlaying = playback.can_pause ? !playback.paused : this.isPlaying;
    this.play.classList.toggle("playing", isPlaying);
    this.play.setAttribute("aria-label", isPlaying ? "Pause" : "Play");
    this.scrub.hidden = !playback.can_scrub;
    this.root.classList.toggle("short", !playback.can_scrub);
    if (playback.can_scrub) this.showTime();
    else setText(byId("play-time"), `${duration(readings?.time_s ?? null)} / ${duration(readings?.duration_s ?? null)}`);
  }

  showTime() {
    const [begin, end] = this.span;
    const time = this.time ?? end;
    const share = end > begin ? (time - begin) / (end - begin) : 1;
    if (!this.isScrubbing) this.scrub.value = String(Math.round(share * SCRUB_STEPS));
    const text = duration(time - begin);
    this.scrub.setAttribute("aria-valuetext", text);
    setText(byId("play-time"), `${text} / ${duration(end - begin)}`);
  }

  offer(choices) {
    if (this.choices === choices.join()) return;
    this.choices = choices.join();
    this.select.replaceChildren(...choices.map((choice) => {
      const option = document.createElement("option");
      option.value = choice === null ? "" : String(choice);
      option.textContent = choice === null ? "fastest" : `${choice}×`;
      return option;
    }));
  }

  /** Ask for the scan of the node that is shown, unless one is on its way. */
  async bringScan(onScan) {
    const now = performance.now();
    const node = this.numNodes - 1;
    if (this.time === null || node < 0 || this.isAsking || this.scan?.number === node) return;
    if (now - (this.asked ?? 0) < SCAN_PERIOD_MS) return;
    this.isAsking = true;
    this.asked = now;
    try {
      const scan = await this.hooks.ask({ type: "node_scan", node });
      if (this.time !== null) this.scan = scan;
      onScan();
    } catch {
      this.scan = null; // the connection is lost, which is shown elsewhere
    } finally {
      this.isAsking = false;
    }
  }
}

/** Return speeds, with one that was chosen elsewhere, as on the command line, in its place. */
function withSpeed(speeds, speed) {
  return speed === null || speeds.includes(speed) ? speeds : [...speeds, speed].sort((a, b) => a - b);
}
