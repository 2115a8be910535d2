// SPDX-License-Identifier: Apache-2.0
/**
 * The composed map in squares, and which of them are out of date because a submap in them has changed.
 * @module
 */
import { poseAt, transform } from "../poses.js";
import { TILE } from "./composer.js";
import { createTarget, createTexture, mipLevels } from "./context.js";

/** Squares overlap by this rim on each side, so that they can be shown magnified without seams. */
export const RIM = 2;
/** Cells of the map that a square is responsible for, along an edge. */
export const STRIDE = TILE - 2 * RIM;
/** Submaps that have moved by less are not composed again [cells]. */
const TOLERANCE_CELLS = 0.005;
/** Squares in which one has moved by more must not be shown, cells. */
const STALE_CELLS = 1.0;
/** Squares are composed within that share of the screen around it. */
const NEAR_SHARE = 0.2;
const MAX_TEXTURES = 200;

/**
 * @typedef {object} Tile
 * @property {number} column
 * @property {number} row
 * @property {WebGLTexture | null} texture
 * @property {WebGLFramebuffer | null} target
 * @property {[number, number, number, number] | null} dirty left, bottom, right, top
 * @property {boolean} stale whether what it shows is wrong, and not only a little old
 * @property {import("./submaps.js").Submap[]} awaited submaps that it shows, while cells of some
 *   are being inflated
 * @property {number} revision rises whenever more of it becomes dirty
 * @property {number} seen number of the frame in which it was last near the screen
 */

/** @typedef {[number, number, number, number]} Box left, bottom, right, top, in cells of the map */

/** The squares. */
export class Tiles {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {import("./composer.js").Composer} composer
   * @param {import("./submaps.js").Submaps} submaps
   */
  constructor(gl, composer, submaps) {
    this.gl = gl;
    this.composer = composer;
    this.submaps = submaps;
    submaps.awaited = () => this.awaited();
    /** @type {Map<string, Tile>} */
    this.all = new Map();
    /** Where each submap is composed now. @type {Map<number, import("../poses.js").Pose>} */
    this.composed = new Map();
    this.numTextures = 0;
    /** Number of the frame that is being drawn. */
    this.frame = 0;
  }

  /** Forget all. */
  begin() {
    this.composed.clear();
    for (const tile of this.all.values()) this.free(tile);
    this.all.clear();
  }

  /**
   * Have submaps composed where they are now.
   * @param {ArrayLike<number>} poses tf_map_submap
   * @param {(submap: number) => boolean} isShown
   */
  place(poses, isShown) {
    for (const submap of this.submaps.all.values()) {
      const id = submap.submap;
      const before = this.composed.get(id);
      const now = 3 * id + 2 < poses.length && isShown(id) ? poseAt(poses, id) : undefined;
      const moved = movement(submap, before, now, this.composer.resolution);
      if (moved <= TOLERANCE_CELLS) continue;
      const stale = before !== undefined && moved > STALE_CELLS;
      if (before) this.markDirty(submap, before, wholeOf(submap), stale);
      if (now) this.markDirty(submap, now, wholeOf(submap), stale);
      if (now) this.composed.set(id, now);
      else this.composed.delete(id);
    }
  }

  /** Part of a submap has changed; without a box, all of it. */
  change(submap, box = wholeOf(submap)) {
    const pose = this.composed.get(submap.submap);
    if (pose) this.markDirty(submap, pose, box, false);
  }

  /** Note that the squares under a box of a submap's cells must be composed again. */
  markDirty(submap, pose, box, stale) {
    const [left, bottom, right, top] = this.extent(submap, pose, box);
    for (let row = Math.floor((bottom - RIM) / STRIDE); row * STRIDE - RIM < top; row++) {
      for (let column = Math.floor((left - RIM) / STRIDE); column * STRIDE - RIM < right; column++) {
        const tile = this.tileAt(column, row);
        const [x, y] = originOf(tile);
        const part = [
          Math.max(0, Math.floor(left - x)), Math.max(0, Math.floor(bottom - y)),
          Math.min(TILE, Math.ceil(right - x)), Math.min(TILE, Math.ceil(top - y)),
        ];
        if (part[0] >= part[2] || part[1] >= part[3]) continue;
        tile.dirty = tile.dirty ? union(tile.dirty, part) : part;
        tile.stale ||= stale;
        tile.revision++;
      }
    }
  }

  /**
   * Return where a box of a submap's cells is.
   * @returns {Box}
   */
  extent(submap, pose, box) {
    const bounds = [Infinity, Infinity, -Infinity, -Infinity];
    for (const col of [box.col - 1, box.col + box.cols]) {
      for (const row of [box.row - 1, box.row + box.rows]) {
        const [x, y] = transform(pose, submap.x + col * submap.resolution,
          submap.y + row * submap.resolution).map((at) => at / this.composer.resolution);
        bounds[0] = Math.min(bounds[0], x);
        bounds[1] = Math.min(bounds[1], y);
        bounds[2] = Math.max(bounds[2], x);
        bounds[3] = Math.max(bounds[3], y);
      }
    }
    return bounds;
  }

  /**
   * Return what reaches into a box.
   * @param {Box} box
   * @returns {Array<[import("./submaps.js").Submap, import("../poses.js").Pose, Box]>} with its pose
   *   and extent
   */
  submapsWithin([left, bottom, right, top]) {
    const found = [];
    for (const [id, pose] of this.composed) {
      const submap = this.submaps.all.get(id);
      if (!submap || submap.spans?.length === 0) continue;
      const extent = this.extent(submap, pose, wholeOf(submap));
      if (extent[0] < right && extent[2] > left && extent[1] < top && extent[3] > bottom) {
        found.push([submap, pose, extent]);
      }
    }
    // In whichever order they came: the last bit of a sum depends on the order of what is added.
    return found.sort(([a], [b]) => b.submap - a.submap);
  }

  /** @returns {Tile} */
  tileAt(column, row) {
    const key = `${column},${row}`;
    let tile = this.all.get(key);
    if (!tile) {
      tile = {
        column, row, texture: null, target: null, dirty: null, stale: true, awaited: [], revision: 0,
        seen: 0,
      };
      this.all.set(key, tile);
    }
    return tile;
  }

  /**
   * Note what is on the screen, and what is near it: that is to be composed.
   * @param {import("../view.js").Bounds} bounds
   */
  see({ left, bottom, right, top }) {
    const near = NEAR_SHARE * Math.max(right - left, top - bottom);
    this.frame++;
    const around = { left: left - near, bottom: bottom - near, right: right + near, top: top + near };
    for (const tile of this.within(around)) tile.seen = this.frame - 0.5;
    for (const tile of this.within({ left, bottom, right, top })) tile.seen = this.frame;
  }

  /** @param {import("../view.js").Bounds} bounds @returns {Tile[]} */
  within({ left, bottom, right, top }) {
    const edge = STRIDE * this.composer.resolution;
    return [...this.all.values()].filter(({ column, row }) => {
      const [x, y] = [column * edge, row * edge];
      return x <= right && x + edge >= left && y <= top && y + edge >= bottom;
    });
  }

  /** Return the square that is to be composed next: of those near the screen, the wrong ones first. */
  next() {
    let best = null;
    for (const tile of this.all.values()) {
      if (!tile.dirty || tile.seen <= this.frame - 1) continue;
      if (tile.awaited.some(({ isInflating }) => isInflating)) continue;
      if (!tile.texture && !this.hasRoomFor(tile)) continue;
      if (!best || rank(tile) > rank(best)) best = tile;
    }
    return best;
  }

  /**
   * Return the submaps that squares near the screen wait for. If the cells of one square were let go
   * of for those of another, and these for the first, neither would ever be composed.
   */
  awaited() {
    const waiting = [...this.all.values()].filter(({ dirty, seen }) => dirty && seen > this.frame - 1);
    return new Set(waiting.flatMap(({ awaited }) => awaited));
  }

  /** Whether there is a texture for a square, be it that of one that is further out of sight. */
  hasRoomFor(tile) {
    if (this.numTextures < MAX_TEXTURES) return true;
    return [...this.all.values()].some(({ texture, seen }) => texture && seen < tile.seen);
  }

  /** Give a square its texture, taking it from the one that was longest out of sight. */
  equip(tile) {
    const { gl } = this;
    if (tile.texture) return;
    if (this.numTextures >= MAX_TEXTURES) {
      const equipped = [...this.all.values()].filter((one) => one.texture);
      this.free(equipped.reduce((a, b) => (a.seen < b.seen ? a : b)));
    }
    tile.texture = createTexture(gl, gl.RGBA8, TILE, TILE, {
      levels: mipLevels(TILE, TILE), min: gl.LINEAR_MIPMAP_NEAREST, mag: gl.LINEAR,
    });
    tile.target = createTarget(gl, tile.texture);
    tile.dirty = [0, 0, TILE, TILE];
    this.numTextures++;
  }

  free(tile) {
    if (!tile.texture) return;
    this.numTextures--;
    this.gl.deleteTexture(tile.texture);
    this.gl.deleteFramebuffer(tile.target);
    Object.assign(tile, { texture: null, target: null, dirty: [0, 0, TILE, TILE], stale: true });
  }
}

/** Return where cell (0, 0) of a square is, cells of the map. @param {Tile} tile */
export function originOf(tile) {
  return [tile.column * STRIDE - RIM, tile.row * STRIDE - RIM];
}

function wholeOf(submap) {
  return { row: 0, col: 0, rows: submap.rows, cols: submap.cols };
}

function union(a, b) {
  return [Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.max(a[2], b[2]), Math.max(a[3], b[3])];
}

function rank(tile) {
  return tile.seen + (tile.stale ? 0.25 : 0);
}

/** Return how far the corners of a submap move, cells of the map. */
function movement(submap, before, now, resolution) {
  if (!before || !now) return before || now ? Infinity : 0;
  let most = 0;
  for (const col of [0, submap.cols]) {
    for (const row of [0, submap.rows]) {
      const [x, y] = [submap.x + col * submap.resolution, submap.y + row * submap.resolution];
      const [ax, ay] = transform(before, x, y);
      const [bx, by] = transform(now, x, y);
      most = Math.max(most, Math.hypot(bx - ax, by - ay));
    }
  }
  return most / resolution;
}
