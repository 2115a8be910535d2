// SPDX-License-Identifier: Apache-2.0
/**
 * The length of something on the screen, as maps have it; the step of the grid; and the coordinates
 * under the pointer.
 * @module
 */
import { byId, setText } from "./dom.js";
import { gridStep, roundLength, roundText } from "./grid.js";

const LONGEST_PX = 160;
const LONGEST_SHARE = 0.12;
const SHORTEST_PX = 70;

/** A bar of a round length, and what belongs beside it. */
export class ScaleBar {
  constructor() {
    this.element = byId("scale");
    this.grid = byId("grid-step");
    this.readout = byId("readout");
    /** Length of the bar [m]. */
    this.metres = 1;
  }

  /** @param {import("./view.js").View} view @param {boolean} hasGrid */
  show(view, hasGrid) {
    const longest = Math.max(SHORTEST_PX, view.width * LONGEST_SHARE);
    this.metres = roundLength(Math.min(LONGEST_PX, longest) / view.scale);
    this.element.firstElementChild.style.width = `${this.metres * view.scale}px`;
    setText(this.element.querySelector("em"), roundText(this.metres));
    this.grid.hidden = !hasGrid;
    setText(this.grid, `grid ${roundText(gridStep(view))}`);
  }

  /** Show where in the map the pointer is. @param {[number, number] | null} point [m, map] */
  point(point) {
    this.readout.hidden = point === null;
    if (point) setText(this.readout, `x ${signed(point[0])}  y ${signed(point[1])} m`);
  }
}

/** Return a coordinate to a centimetre, with a true minus. */
function signed(metres) {
  return metres.toFixed(2).replace(/^-/, "\u2212").replace(/^\u22120\.00$/, "0.00");
}
