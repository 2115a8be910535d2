// SPDX-License-Identifier: Apache-2.0
/**
 * The verdict on the finished map, and the list of places that may be wrong.
 * @module
 */
import { byId, setText } from "./dom.js";

/** Space around a place that is shown [m]. */
const MARGIN_M = 3;

/** Shows QUALITY. */
export class Places {
  /** @param {(bounds: {left: number, right: number, bottom: number, top: number}) => void} onShow */
  constructor(onShow) {
    this.onShow = onShow;
    this.list = byId("places");
    this.verdict = byId("read-quality");
  }

  /** @param {{verdict: string, places: object[]} | null} quality */
  show(quality) {
    this.verdict.parentElement.hidden = quality === null;
    setText(this.verdict, quality?.verdict ?? "");
    this.list.replaceChildren(...(quality?.places ?? []).map((place) => this.row(place)));
  }

  row({ x, y, radius, severity, reason, advice }) {
    const [row, button] = ["li", "button"].map((tag) => document.createElement(tag));
    button.type = "button";
    button.dataset.severity = severity;
    button.textContent = `${severity}: ${reason}`;
    button.title = advice;
    const reach = radius + MARGIN_M;
    button.addEventListener("click", () => this.onShow({
      left: x - reach, right: x + reach, bottom: y - reach, top: y + reach,
    }));
    row.append(button);
    return row;
  }
}
