// SPDX-License-Identifier: Apache-2.0
/**
 * How the cells of a submap lie in memory and on the graphics card: row by row, with a rim of
 * unknown ones, so that neighbours can be looked up without asking whether there are any.
 * @module
 */

/** Edge of a block of cells, which is drawn only if any of them is known. */
export const BLOCK = 32;
/** Edge of the square of cells that is a pixel of the preview. */
export const SHRINK = 4;
/** Unknown cells left of the first; as many as let four cells be looked at as one number. */
export const MARGIN = 4;

/** Return the bytes of a row: a margin, its cells, and one unknown at least. */
export function strideOf(cols) {
  return MARGIN + 4 * Math.ceil((cols + 1) / 4);
}
