// SPDX-License-Identifier: Apache-2.0
/**
 * Colours of the map as shares of floor, wall and ground.
 *
 * Means of these two give means of colours, so that a map that is seen from afar keeps its walls,
 * and the colours themselves can be others when it is dark.
 * @module
 */

/** @typedef {[number, number, number]} Rgb */

const LEVELS = 256;

/**
 * @typedef {object} MapColours
 * @property {Rgb} ground of what is unknown
 * @property {Rgb} floor of what is surely free
 * @property {Rgb} wall of what is surely occupied
 */

/**
 * Return the colours of the exported map.
 * @param {Rgb[]} palette by level, the last of what is unknown
 * @returns {MapColours}
 */
function lightColours(palette) {
  return { ground: palette[LEVELS], floor: palette[0], wall: palette[LEVELS - 1] };
}

/**
 * Return how much floor and how much wall the colour of each level is, 255ths: two bytes a level.
 * @param {Rgb[]} palette
 */
export function shadesOf(palette) {
  const { ground, floor, wall } = lightColours(palette);
  const found = new Uint8Array(2 * LEVELS);
  for (let level = 0; level < LEVELS; level++) {
    const shares = [floor, wall].map((end) => shareOf(palette[level], ground, end));
    const better = shares[0].error <= shares[1].error ? 0 : 1;
    found[2 * level + better] = Math.round(255 * shares[better].share);
  }
  return found;
}

/** Return how far a colour is on the way from one to another, and how far off that way. */
function shareOf(colour, from, to) {
  const way = to.map((value, i) => value - from[i]);
  const part = colour.map((value, i) => value - from[i]);
  const length = way.reduce((sum, value) => sum + value * value, 0);
  const along = way.reduce((sum, value, i) => sum + value * part[i], 0);
  const share = length > 0 ? Math.min(Math.max(along / length, 0), 1) : 0;
  const error = part.reduce((sum, value, i) => sum + (value - share * way[i]) ** 2, 0);
  return { share, error };
}

/**
 * Return the same by the byte of a submap's cell, for cells that several submaps agree on.
 * @param {{log_odds: number[], palette: Rgb[]}} hello
 * @param {number} agreeing
 */
export function shadesOfCells(hello, agreeing) {
  const ofLevels = shadesOf(hello.palette);
  const found = new Uint8Array(2 * hello.log_odds.length);
  hello.log_odds.forEach((evidence, cell) => {
    const level = Math.round(255 / (1 + Math.exp(-agreeing * evidence)));
    found.set(ofLevels.subarray(2 * level, 2 * level + 2), 2 * cell);
  });
  return found;
}
