// SPDX-License-Identifier: Apache-2.0
/**
 * The measuring tape: from wall to wall, square to them, as one would hold it.
 * @module
 */
import { findWall } from "./wall_fit.js";

/** A tape that is held askew by less is meant square to the wall. */
const SQUARE_TAN = Math.tan((14 * Math.PI) / 180);
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
