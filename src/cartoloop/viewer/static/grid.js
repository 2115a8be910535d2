// SPDX-License-Identifier: Apache-2.0
/**
 * Round lengths: of the scale bar, and of the grid in metres.
 * @module
 */

/** Lines of the grid are at least so far apart [px]. */
const LEAST_PX = 64;
/** Every fifth line is stronger. */
const STRONG = 5;

/** @typedef {{x: number | null, y: number | null, strong: boolean}} GridLine x or y is that of the line [m] */

/** Return the greatest of ..., 0.1, 0.2, 0.5, 1, 2, 5, 10, ... that is at most this. */
export function roundLength(limit) {
  const power = 10 ** Math.floor(Math.log10(limit));
  return [5, 2, 1].find((factor) => factor * power <= limit * (1 + 1e-9)) * power;
}

/** Return how far the lines of the grid are apart [m]. @param {import("./view.js").View} view */
export function gridStep(view) {
  let step = roundLength(LEAST_PX / view.scale);
  while (step * view.scale < LEAST_PX) step = roundLength(step * 2.5);
  return step;
}

/**
 * Return the lines of the grid that are in sight, at multiples of the step.
 * @param {import("./view.js").Bounds} bounds
 * @param {number} step [m]
 * @returns {GridLine[]}
 */
export function gridLines({ left, bottom, right, top }, step) {
  const lines = [];
  for (let i = Math.ceil(left / step); i * step <= right; i++) {
    lines.push({ x: i * step, y: null, strong: i % STRONG === 0 });
  }
  for (let i = Math.ceil(bottom / step); i * step <= top; i++) {
    lines.push({ x: null, y: i * step, strong: i % STRONG === 0 });
  }
  return lines;
}

/** Return a length of the scale or the grid as text. */
export function roundText(metres) {
  return metres < 1 ? `${Math.round(metres * 100)} cm` : `${metres} m`;
}
