// SPDX-License-Identifier: Apache-2.0
/**
 * Measurements on the map: on the screen, and in pictures of it.
 * @module
 */
import { svg } from "./dom.js";
import { valueOf } from "./measures_values.js";

const LABEL_PX = 26;
const END_PX = 5;

/** @typedef {import("./measures.js").Measure} Measure */

/**
 * Draw all, and the one that hangs on the pointer.
 * @param {SVGElement} layer
 * @param {import("./view.js").View} view
 * @param {Measure[]} measures
 * @param {Measure | null} begun
 */
export function drawMeasures(layer, view, measures, begun) {
  const shapes = begun ? [...measures, begun] : measures;
  layer.replaceChildren(...shapes.flatMap((measure) => drawn(layer, view, measure)));
}

function drawn(layer, view, measure) {
  const places = measure.points.map((point) => view.toScreen(...point));
  const points = places.map((place) => place.map((at) => at.toFixed(1)).join(",")).join(" ");
  const shape = measure.kind === "area" && places.length > 2 ? "polygon" : "polyline";
  const ends = places.map(([cx, cy], i) => svg(layer, "circle",
    { cx, cy, r: END_PX, class: measure.onWall[i] ? "tape-end snapped" : "tape-end" }));
  const lines = [svg(layer, shape, { points, class: "tape-halo" }), svg(layer, shape, { points, class: "tape-line" })];
  const text = textOf(measure);
  return text ? [...lines, ...ends, label(layer, text, labelPlace(measure.kind, places))] : [...lines, ...ends];
}

function label(layer, text, [x, y]) {
  const width = 18 + 8.4 * text.length;
  const words = svg(layer, "text", { x, y });
  words.textContent = text;
  return svg(layer, "g", { class: "tape-label" }, [
    svg(layer, "rect", {
      x: x - width / 2, y: y - LABEL_PX / 2, width, height: LABEL_PX, rx: LABEL_PX / 2,
    }), words,
  ]);
}

/** Return the value of a measurement, "" as long as it has too few points to have one. */
function textOf(measure) {
  const least = { length: 2, angle: 3, area: 3 }[measure.kind];
  return measure.points.length < least ? "" : valueOf(measure).value;
}

/** Return where the value is written: between the ends, beside the corner, in the middle. */
function labelPlace(kind, places) {
  const mean = (index) => places.reduce((sum, place) => sum + place[index], 0) / places.length;
  if (kind !== "angle") return [mean(0), mean(1)];
  const [x, y] = places[1];
  const [dx, dy] = [mean(0) - x, mean(1) - y];
  const far = Math.max(Math.hypot(dx, dy), 1);
  return [x + (44 * dx) / far, y + (44 * dy) / far];
}

/**
 * Draw all into a picture of the screen.
 * @param {CanvasRenderingContext2D} context
 * @param {CSSStyleDeclaration} style
 * @param {import("./view.js").View} view
 * @param {Measure[]} measures
 */
export function drawMeasuresInto(context, style, view, measures) {
  const [accent, onAccent] = ["--accent", "--on-accent"].map((name) => style.getPropertyValue(name));
  Object.assign(context, { lineWidth: 2, textAlign: "center", textBaseline: "middle" });
  context.font = `600 14px ${style.fontFamily}`;
  for (const measure of measures) {
    const places = measure.points.map((point) => view.toScreen(...point));
    context.strokeStyle = context.fillStyle = accent;
    context.beginPath();
    places.forEach(([x, y]) => context.lineTo(x, y));
    if (measure.kind === "area") context.closePath();
    context.stroke();
    for (const [x, y] of places) context.fillRect(x - 4, y - 4, 8, 8);
    const text = textOf(measure);
    const [x, y] = labelPlace(measure.kind, places);
    const width = context.measureText(text).width + 18;
    context.fillRect(x - width / 2, y - LABEL_PX / 2, width, LABEL_PX);
    context.fillStyle = onAccent;
    context.fillText(text, x, y);
  }
}
