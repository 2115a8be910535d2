// SPDX-License-Identifier: Apache-2.0
/**
 * Measurements: lengths, angles and areas, put down with clicks, kept in a list and in the browser.
 * @module
 */
import { byId, setText, store, stored } from "./dom.js";
import { drawMeasures, drawMeasuresInto } from "./measures_drawing.js";
import { distance, KINDS, linesText, valueOf } from "./measures_values.js";
import { saveBlob } from "./save.js";
import { snapTape } from "./tape.js";

const KEY = "cartoloop.measures.";
/** Within this of the pointer a wall is meant [px, m]. */
const SNAP_PX = 16;
const LEAST_SNAP_M = 0.3;
const MOST_SNAP_M = 1.0;
/** A click so near an end holds it, and one so near the first corner closes an area [px]. */
const GRAB_PX = 18;
/** More of them than that are not kept in the browser. */
const MOST_KEPT = 200;

/** What to do next, by the number of points that are put down. */
const NEXT = {
  length: ["Click where it begins; ends snap to walls.", "Click where it ends."],
  angle: ["Click on the first side.", "Click on the corner.", "Click on the other side."],
  area: ["Click on the first corner.", "Click on the next corner.", "Click on the next corner.",
    "Click on the next corner; on the first, or Enter, to close it."],
};

/** @typedef {[number, number]} Point [m, map] */

/**
 * @typedef {object} Measure
 * @property {"length" | "angle" | "area"} kind
 * @property {Point[]} given where it was put down
 * @property {Point[]} points of lengths, on the walls that were found; otherwise as given
 * @property {boolean} snaps whether its ends snap to walls
 * @property {boolean[]} onWall of a length: which of its ends are on walls
 * @property {boolean} isPartial whether the map there is still to come
 * @property {number | null} tape what a tape in the building said of a length [m]
 */

/** The measurements of a map. */
export class Measures {
  /**
   * @param {import("./view.js").View} view
   * @param {object} hooks
   * @param {(point: Point, reach: number) => import("./wall_fit.js").Levels} hooks.levelsAround
   * @param {(text: string) => void} hooks.onHint
   * @param {(bounds: import("./view.js").Bounds) => void} hooks.onShow
   */
  constructor(view, hooks) {
    this.view = view;
    this.hooks = hooks;
    this.layer = byId("tape-layer");
    this.card = byId("measures");
    this.list = byId("measures-list");
    this.isOn = false;
    this.name = "";
    /** Under which the list is kept; "" while the map grows. */
    this.key = "";
    /** @type {"length" | "angle" | "area"} */
    this.kind = "length";
    /** @type {Measure[]} */
    this.all = [];
    /** Points of the one that is being put down. @type {Point[]} */
    this.begun = [];
    this.held = null;
    for (const choice of document.querySelectorAll("[name=measure]")) {
      choice.addEventListener("change", () => this.choose(choice.value));
    }
    byId("measures-save").addEventListener("click", () => this.save());
    byId("measures-clear").addEventListener("click", () => this.clear());
  }

  /** A map is shown. What was measured stays if the connection was only lost. @param {string} name */
  begin(name) {
    if (name === this.name) return;
    this.name = name;
    this.key = "";
    this.begun = [];
    this.all = [];
    this.show();
  }

  /**
   * The map grows no more: bring back what was measured in it, and keep what will be.
   * @param {{described: [string, string][]}} facts by which the same map is known again
   */
  bringBack({ described }) {
    this.key = [KEY, this.name, ...described.map(([, text]) => text)].join(" ");
    if (this.all.length === 0) {
      this.all = stored(this.key, []).filter(isMeasure).map((kept) => ({ ...kept, isPartial: false }));
    }
    this.show();
  }

  /** The length that was measured last, null if there is none in sight. */
  get last() {
    return this.isOn ? this.all.findLast(({ kind }) => kind === "length") ?? null : null;
  }

  toggle(isOn = !this.isOn) {
    this.isOn = isOn;
    this.begun = [];
    if (!isOn && this.card.contains(document.activeElement)) document.activeElement.blur();
    this.card.hidden = !isOn;
    this.show();
  }

  choose(kind) {
    this.kind = kind;
    this.begun = [];
    this.show();
  }

  /** Forget the one that is being put down; return whether there was any. */
  cancel() {
    const hadBegun = this.begun.length > 0;
    this.begun = [];
    this.show();
    return hadBegun;
  }

  /** Put down a point. @param {boolean} snaps whether lengths snap to walls */
  click(px, py, snaps) {
    const { most } = KINDS[this.kind];
    if (this.begun.length >= 3 && this.isNear(this.begun[0], px, py)) {
      this.finish(snaps);
      return;
    }
    const point = this.view.toMap(px, py);
    const last = this.begun.at(-1);
    if (last && this.isNear(last, px, py, 2)) return; // the second click of a double one
    this.begun.push(point);
    if (this.begun.length === most) this.finish(snaps);
    else this.show(px, py);
  }

  /** The one that is being put down has all its points. */
  finish(snaps = true) {
    const { least } = KINDS[this.kind];
    if (this.begun.length < least) return;
    this.all.push(this.measured({ kind: this.kind, given: this.begun, snaps, tape: null }));
    this.begun = [];
    this.keep();
    this.show();
  }

  isNear(point, px, py, within = GRAB_PX) {
    const [x, y] = this.view.toScreen(...point);
    return Math.hypot(x - px, y - py) < within;
  }

  /** Hold a point that is there; return whether there is one. */
  press(px, py) {
    this.held = null;
    if (!this.isOn || this.begun.length > 0) return false;
    for (const measure of this.all) {
      measure.points.forEach((point, index) => {
        if (this.isNear(point, px, py)) this.held = { measure, index };
      });
    }
    return this.held !== null;
  }

  drag(px, py, snaps) {
    if (!this.held) return;
    const { measure, index } = this.held;
    measure.given = measure.points.map((point, i) => (i === index ? this.view.toMap(px, py) : point));
    Object.assign(measure, this.measured({ ...measure, snaps }));
    this.keep();
    this.show();
  }

  hover(px, py) {
    if (this.begun.length > 0) this.draw(px, py);
  }

  /** @returns {Measure} */
  measured({ kind, given, snaps, tape }) {
    const plain = { kind, given, snaps, tape, points: given, onWall: [false, false], isPartial: false };
    if (kind !== "length" || !snaps) return plain;
    const reach = Math.min(Math.max(SNAP_PX / this.view.scale, LEAST_SNAP_M), MOST_SNAP_M);
    const { a, b, onA, onB, isPartial } = snapTape(this.hooks.levelsAround, given[0], given[1], reach);
    return { ...plain, points: [a, b], onWall: [onA, onB], isPartial };
  }

  /** More of the map has come: measure again where it was missing. */
  refresh() {
    const waiting = this.isOn ? this.all.filter(({ isPartial }) => isPartial) : [];
    for (const measure of waiting) Object.assign(measure, this.measured(measure));
    if (waiting.length > 0) this.show();
  }

  remove(measure) {
    this.all = this.all.filter((other) => other !== measure);
    this.keep();
    this.show();
  }

  clear() {
    this.all = [];
    this.begun = [];
    this.keep();
    this.show();
  }

  /** Keep the list in the browser: it took a walk through the map. */
  keep() {
    if (this.key) store(this.key, this.all.slice(-MOST_KEPT));
  }

  /** Save what was measured, as `cartoloop evaluate lines` reads it. */
  save() {
    if (!this.all.some(({ kind }) => kind === "length")) {
      this.hooks.onHint("The file holds lengths: measure one first. Angles and areas are comments in it.");
      return;
    }
    const text = linesText(this.name, this.all);
    const name = this.name.replace(/[^\w.-]+/g, "_").slice(0, 80) || "map";
    saveBlob(new Blob([text], { type: "text/plain" }), `${name}.lines`);
  }

  // What is seen of it

  /** Show the list and the drawing. */
  show(px, py) {
    setText(byId("measures-next"), NEXT[this.kind][Math.min(this.begun.length, NEXT[this.kind].length - 1)]);
    this.list.replaceChildren(...this.all.map((measure, i) => this.row(measure, i + 1)));
    this.draw(px, py);
  }

  draw(px, py) {
    if (!this.isOn) {
      this.layer.replaceChildren();
      return;
    }
    const begun = this.begun.length === 0 ? null : {
      kind: this.kind, isBegun: true, onWall: [],
      points: px === undefined ? this.begun : [...this.begun, this.view.toMap(px, py)],
    };
    drawMeasures(this.layer, this.view, this.all, begun);
  }

  /** @param {CanvasRenderingContext2D} context of a picture of the screen */
  drawInto(context) {
    if (this.isOn) drawMeasuresInto(context, getComputedStyle(this.layer), this.view, this.all);
  }

  row(measure, number) {
    const [row, where, remove] = ["li", "button", "button"].map((tag) => document.createElement(tag));
    const [order, value, detail] = ["span", "strong", "small"].map((tag) => document.createElement(tag));
    const texts = valueOf(measure);
    order.textContent = String(number);
    value.textContent = texts.value;
    detail.textContent = texts.detail;
    where.className = "where";
    where.title = "Show it on the map";
    where.append(order, value, detail);
    where.addEventListener("click", () => this.hooks.onShow(boundsOf(measure.points)));
    remove.className = "quiet";
    remove.textContent = "\u00d7";
    remove.setAttribute("aria-label", `Delete measurement ${number}`);
    remove.addEventListener("click", () => this.remove(measure));
    row.append(where, remove);
    if (measure.kind === "length") row.append(this.tapeInput(measure, number));
    return row;
  }

  /** A field for what a tape in the building said, which `evaluate lines` compares with the map. */
  tapeInput(measure, number) {
    const [label, input, error] = ["label", "input", "span"].map((tag) => document.createElement(tag));
    const show = () => {
      const by = measure.tape === null ? NaN : 100 * (distance(...measure.points) - measure.tape);
      error.textContent = Number.isFinite(by) ? `map ${by < 0 ? "\u2212" : "+"}${Math.abs(by).toFixed(1)} cm` : "";
    };
    Object.assign(input, { type: "text", inputMode: "decimal", value: measure.tape ?? "", placeholder: "m" });
    input.setAttribute("aria-label", `Length ${number} by a tape in the building, in metres`);
    input.addEventListener("change", () => {
      const metres = Number(input.value.replace(",", "."));
      measure.tape = input.value.trim() !== "" && metres > 0 && Number.isFinite(metres) ? metres : null;
      input.value = measure.tape ?? "";
      this.keep();
      show();
    });
    label.append("by tape ", input, error);
    show();
    return label;
  }
}

function boundsOf(points) {
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  return {
    left: Math.min(...xs) - 1, right: Math.max(...xs) + 1, bottom: Math.min(...ys) - 1,
    top: Math.max(...ys) + 1,
  };
}

/** Whether what was stored is a measurement: another program may have written there. */
function isMeasure(kept) {
  const range = KINDS[kept?.kind];
  return Boolean(range) && typeof kept.snaps === "boolean" && (kept.tape === null || kept.tape > 0)
    && Array.isArray(kept.onWall) && [kept.given, kept.points].every((points) => Array.isArray(points)
      && points.length >= range.least && points.length <= range.most && points.every(isPoint));
}

function isPoint(point) {
  return Array.isArray(point) && point.length === 2 && point.every(Number.isFinite);
}
