// SPDX-License-Identifier: Apache-2.0
/**
 * The measuring tape: from wall to wall, square to them, as one would hold it.
 * @module
 */
import { svg } from "./dom.js";
import { findWall } from "./wall_fit.js";

/** Within this of the pointer a wall is meant [px, m]. */
const SNAP_PX = 16;
const LEAST_SNAP_M = 0.3;
const MOST_SNAP_M = 1.0;
/** A tape that is held askew by less is meant square to the wall. */
const SQUARE_TAN = Math.tan((14 * Math.PI) / 180);
const GRAB_PX = 18;
const SHORTEST_M = 0.1;
/** What is looked at around a wall to find its face. */
const RIM_M = 0.5;

/** @typedef {[number, number]} Point [m, map] */

/**
 * @typedef {object} Measured
 * @property {Point} a
 * @property {Point} b
 * @property {boolean} onA whether that end is on a wall
 * @property {boolean} onB
 * @property {boolean} isPartial whether the map there is still to come
 */

/**
 * Return a tape with its ends on the walls that they were put at, and square to these.
 * @param {(point: Point, reach: number) => import("./wall_fit.js").Levels} levelsAround of the map
 * @param {Point} a
 * @param {Point} b
 * @param {number} reach how far from an end a wall may be [m]
 * @returns {Measured}
 */
export function snapTape(levelsAround, a, b, reach) {
  const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
  const half = Math.hypot(b[0] - a[0], b[1] - a[1]) / 2;
  if (2 * half < SHORTEST_M) return { a, b, onA: false, onB: false, isPartial: false };
  let along = [(b[0] - a[0]) / (2 * half), (b[1] - a[1]) / (2 * half)];
  const [near, far] = [Math.max(0, half - reach), half + reach];
  const aside = reach + RIM_M + half * SQUARE_TAN;
  const [atA, atB] = [levelsAround(a, aside), levelsAround(b, aside)];
  let [wallA, wallB] = [null, null];
  for (let turn = 0; turn < 3; turn++) {
    wallA = findWall(atA, middle, [-along[0], -along[1]], near, far);
    wallB = findWall(atB, middle, along, near, far);
    // Walls that recede to the left of the direction are square to it when it turns left.
    const slopes = [wallA, wallB].filter((wall) => wall && Math.abs(wall.slope) < SQUARE_TAN)
      .map(({ slope }) => slope);
    if (slopes.length === 0 || turn === 2) break;
    if (slopes.length === 2 && Math.abs(slopes[0] - slopes[1]) > 0.1) break;
    const turnBy = -Math.atan(slopes.reduce((sum, slope) => sum + slope, 0) / slopes.length);
    along = [along[0] * Math.cos(turnBy) - along[1] * Math.sin(turnBy),
      along[0] * Math.sin(turnBy) + along[1] * Math.cos(turnBy)];
  }
  const [da, db] = [wallA?.distance ?? half, wallB?.distance ?? half];
  return {
    a: [middle[0] - along[0] * da, middle[1] - along[1] * da],
    b: [middle[0] + along[0] * db, middle[1] + along[1] * db],
    onA: wallA !== null, onB: wallB !== null, isPartial: atA.isPartial || atB.isPartial,
  };
}

/** Tapes on the map. */
export class Tape {
  /**
   * @param {SVGElement} layer
   * @param {import("./view.js").View} view
   * @param {object} hooks
   * @param {(point: Point, reach: number) => import("./wall_fit.js").Levels} hooks.levelsAround
   * @param {(text: string) => void} hooks.onHint
   */
  constructor(layer, view, hooks) {
    this.layer = layer;
    this.view = view;
    this.hooks = hooks;
    this.isOn = false;
    /** @type {Array<Measured & {given: [Point, Point]}>} */
    this.tapes = [];
    /** @type {Point | null} */
    this.first = null;
    this.held = null;
  }

  /** What was measured last, null if nothing is. */
  get last() {
    return this.tapes.at(-1) ?? null;
  }

  /** Take the tape into the hand, or put it away. */
  toggle(isOn = !this.isOn) {
    this.isOn = isOn;
    this.first = null;
    if (!isOn) this.tapes = [];
    this.hooks.onHint(isOn ? "Click where the tape begins." : "");
    this.draw();
  }

  /** Put down an end. @param {boolean} snaps whether to look for walls */
  click(px, py, snaps) {
    const point = this.view.toMap(px, py);
    if (!this.first) {
      this.first = point;
      this.hooks.onHint("Click where it ends.");
    } else {
      const tape = { given: [this.first, point], snaps };
      this.first = null;
      this.tapes.push(tape);
      this.measure(tape);
      this.report(tape);
    }
    this.draw(px, py);
  }

  /** Hold an end that is there; return whether there is one. */
  press(px, py) {
    this.held = null;
    for (const tape of this.tapes) {
      for (const [index, end] of [tape.a, tape.b].entries()) {
        const [x, y] = this.view.toScreen(...end);
        if (Math.hypot(x - px, y - py) < GRAB_PX) this.held = { tape, index };
      }
    }
    return this.held !== null;
  }

  drag(px, py, snaps) {
    if (!this.held) return;
    const { tape, index } = this.held;
    tape.given = [tape.a, tape.b];
    tape.given[index] = this.view.toMap(px, py);
    tape.snaps = snaps;
    this.measure(tape);
    this.report(tape);
    this.draw();
  }

  hover(px, py) {
    if (this.isOn && this.first) this.draw(px, py);
  }

  measure(tape) {
    const [a, b] = tape.given;
    Object.assign(tape, { a, b, onA: false, onB: false, isPartial: false });
    if (!tape.snaps) return;
    const reach = Math.min(Math.max(SNAP_PX / this.view.scale, LEAST_SNAP_M), MOST_SNAP_M);
    Object.assign(tape, snapTape(this.hooks.levelsAround, a, b, reach));
  }

  /** More of the map has come: measure again where it was missing. */
  refresh() {
    for (const tape of this.tapes.filter(({ isPartial }) => isPartial)) {
      this.measure(tape);
      if (!tape.isPartial) this.report(tape);
      this.draw();
    }
  }

  report(tape) {
    const ends = Number(tape.onA) + Number(tape.onB);
    const how = ["between two points", "from a wall to a point", "from wall to wall"][ends];
    this.hooks.onHint(`${lengthOf(tape).toFixed(2)} m ${how}`);
  }

  /** Draw all, and the one that hangs on the pointer. */
  draw(px, py) {
    this.layer.replaceChildren(...this.tapes.flatMap((tape) => this.drawn(tape)));
    if (!this.first) return;
    const end = px === undefined ? this.first : this.view.toMap(px, py);
    this.layer.append(...this.drawn({ a: this.first, b: end, onA: false, onB: false }));
  }

  /** Draw all into a picture of the screen. @param {CanvasRenderingContext2D} context */
  drawInto(context) {
    const style = getComputedStyle(this.layer);
    const [accent, onAccent] = ["--accent", "--on-accent"].map((name) => style.getPropertyValue(name));
    context.scale(this.view.ratio, this.view.ratio);
    Object.assign(context, { lineWidth: 2, textAlign: "center", textBaseline: "middle" });
    context.font = `600 14px ${style.fontFamily}`;
    for (const tape of this.tapes) {
      const [ax, ay] = this.view.toScreen(...tape.a);
      const [bx, by] = this.view.toScreen(...tape.b);
      const text = `${lengthOf(tape).toFixed(2)} m`;
      const width = context.measureText(text).width + 18;
      const [x, y] = [(ax + bx) / 2, (ay + by) / 2];
      context.strokeStyle = context.fillStyle = accent;
      context.beginPath();
      context.moveTo(ax, ay);
      context.lineTo(bx, by);
      context.stroke();
      for (const [cx, cy] of [[ax, ay], [bx, by]]) context.fillRect(cx - 4, cy - 4, 8, 8);
      context.fillRect(x - width / 2, y - 13, width, 26);
      context.fillStyle = onAccent;
      context.fillText(text, x, y);
    }
  }

  drawn(tape) {
    const { layer } = this;
    const [ax, ay] = this.view.toScreen(...tape.a);
    const [bx, by] = this.view.toScreen(...tape.b);
    const ends = { x1: ax, y1: ay, x2: bx, y2: by };
    const text = `${lengthOf(tape).toFixed(2)} m`;
    const width = 18 + 8.4 * text.length;
    const [x, y] = [(ax + bx) / 2, (ay + by) / 2];
    const label = svg(layer, "text", { x, y });
    label.textContent = text;
    return [
      svg(layer, "line", { ...ends, class: "tape-halo" }),
      svg(layer, "line", { ...ends, class: "tape-line" }),
      ...[[ax, ay, tape.onA], [bx, by, tape.onB]].map(([cx, cy, on]) => svg(layer, "circle",
        { cx, cy, r: 5, class: on ? "tape-end snapped" : "tape-end" })),
      svg(layer, "g", { class: "tape-label" }, [
        svg(layer, "rect", { x: x - width / 2, y: y - 13, width, height: 26, rx: 13 }), label,
      ]),
    ];
  }
}

/** Return how long a tape is [m]. */
export function lengthOf({ a, b }) {
  return Math.hypot(b[0] - a[0], b[1] - a[1]);
}
