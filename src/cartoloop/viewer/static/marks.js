// SPDX-License-Identifier: Apache-2.0
/**
 * Words on the map: which end of the way is which, how probable a place is.
 * @module
 */
import { byId, svg } from "./dom.js";
import { endsOf } from "./overlays.js";
import { transform } from "./poses.js";
import { percent } from "./words.js";

const WORDS = Object.freeze({ start: "Start", end: "End" });
/** From a point to the middle of its label, across and up [px]; at the other side where both are near. */
const ASIDE_PX = 38;
const NEAR_PX = 40;
/** From a place to the middle of its label [px]. */
const BEHIND_PX = 30;
/** More labels than these hide the map. */
const MOST_PLACES = 6;

/** Labels beside points of the map. */
export class Marks {
  /** @param {import("./view.js").View} view */
  constructor(view) {
    this.layer = byId("marks-layer");
    this.view = view;
    /** @type {{text: string, x: number, y: number}[]} */
    this.labels = [];
  }

  /** @param {import("./overlays.js").Scene} scene */
  show(scene) {
    this.labels = scene.layers.ends ? this.labelsOf(endsOf(scene)) : [];
    if (scene.state.localisation && scene.layers.candidates) {
      this.labels = this.labelsOfPlaces(scene.state.localisation.places);
    }
    this.layer.replaceChildren(...this.labels.map(({ text, x, y }) => {
      const label = svg(this.layer, "text", { x, y });
      label.textContent = text;
      const width = 14 + 7.4 * text.length;
      return svg(this.layer, "g", { class: "mark" }, [
        svg(this.layer, "rect", { x: x - width / 2, y: y - 10, width, height: 20, rx: 5 }), label,
      ]);
    }));
  }

  /** Return the probabilities of the likeliest places, each behind its arrow. */
  labelsOfPlaces(places) {
    return places.slice(0, MOST_PLACES).map(({ map, probability }) => {
      const [x, y] = this.view.toScreen(...transform(map, -BEHIND_PX / this.view.scale, 0));
      return { text: percent(probability), x, y };
    });
  }

  labelsOf(ends) {
    const placed = ends.map(({ name, at }) => {
      const [x, y] = this.view.toScreen(at[0], at[1]);
      return { text: WORDS[name], x: x + ASIDE_PX, y };
    });
    const [start, end] = placed;
    if (end && Math.hypot(start.x - end.x, start.y - end.y) < NEAR_PX) start.x -= 2 * ASIDE_PX;
    return placed;
  }

  /** Draw the labels into a picture of the screen. @param {CanvasRenderingContext2D} context */
  drawInto(context) {
    const style = getComputedStyle(this.layer);
    Object.assign(context, { textAlign: "center", textBaseline: "middle" });
    context.font = `600 12px ${style.fontFamily}`;
    for (const { text, x, y } of this.labels) {
      const width = context.measureText(text).width + 12;
      context.fillStyle = style.getPropertyValue("--card");
      context.fillRect(x - width / 2, y - 10, width, 20);
      context.fillStyle = style.getPropertyValue("--ink");
      context.fillText(text, x, y);
    }
  }
}
