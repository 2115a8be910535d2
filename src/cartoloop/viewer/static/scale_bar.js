// SPDX-License-Identifier: Apache-2.0
/**
 * The length of something on the screen, as maps have it.
 * @module
 */
import { byId, setText } from "./dom.js";

const LONGEST_PX = 160;
const LONGEST_SHARE = 0.12;
const SHORTEST_PX = 70;

/** A bar of a round length. */
export class ScaleBar {
  constructor() {
    this.element = byId("scale");
  }

  /** @param {import("./view.js").View} view */
  show(view) {
    const longest = Math.max(SHORTEST_PX, view.width * LONGEST_SHARE);
    const limit = Math.min(LONGEST_PX, longest) / view.scale;
    const power = 10 ** Math.floor(Math.log10(limit));
    const metres = [5, 2, 1].find((factor) => factor * power <= limit) * power;
    this.element.firstElementChild.style.width = `${metres * view.scale}px`;
    setText(this.element.lastElementChild, metres < 1 ? `${Math.round(metres * 100)} cm` : `${metres} m`);
  }
}
