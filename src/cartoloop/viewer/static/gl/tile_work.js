// SPDX-License-Identifier: Apache-2.0
/**
 * Composes squares a slice at a time, so that the hands on the map never wait for it; and small parts
 * of the map at once, for measuring.
 * @module
 */
import { TILE } from "./composer.js";
import { createTarget, createTexture } from "./context.js";
import { originOf } from "./tiles.js";

/** Whether a slice is done is seen with the next frame only. */
const FRAME_MS = 17;
const FIRST_SLICE_CELLS = 5e5;
/** What a drawing costs at least, in cells. */
const LEAST_CELLS = 1e4;

/** Does the work there is. */
export class TileWork {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {import("./tiles.js").Tiles} tiles
   */
  constructor(gl, tiles) {
    this.gl = gl;
    this.tiles = tiles;
    this.composer = tiles.composer;
    /** @type {{tile: import("./tiles.js").Tile, left: Array, box: number[], revision: number} | null} */
    this.job = null;
    /** Set behind what the graphics card was last given to do. @type {WebGLSync | null} */
    this.fence = null;
    this.sliceCells = FIRST_SLICE_CELLS;
    /** How many squares have been composed so far. */
    this.numComposed = 0;
    this.scratch = createTexture(gl, gl.RGBA8, TILE, TILE);
    this.scratchTarget = createTarget(gl, this.scratch);
  }

  /** Whether all that is near the screen is up to date. */
  get isDone() {
    return this.job === null && this.fence === null && this.tiles.next() === null;
  }

  /** Drop what was begun. */
  drop() {
    this.job = null;
  }

  /**
   * Compose for about this time, unless the graphics card is still at the last slice.
   * @param {number} sliceMs
   * @returns {boolean} whether there is more to do
   */
  advance(sliceMs) {
    if (this.fence && !this.isFenceDone(sliceMs)) return true;
    const began = performance.now();
    let cells = 0;
    while (cells < this.sliceCells && this.takeJob()) cells += this.addSubmaps(this.sliceCells - cells);
    if (cells === 0) return false;
    this.fence = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.began = began;
    this.gl.flush();
    return true;
  }

  /** Look whether the last slice is done, and learn from how long it took. */
  isFenceDone(sliceMs) {
    const { gl } = this;
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    gl.deleteSync(this.fence);
    this.fence = null;
    const factor = performance.now() - this.began < sliceMs + FRAME_MS ? 1.5 : 0.6;
    this.sliceCells = Math.min(Math.max(this.sliceCells * factor, 1e5), 5e7);
    return true;
  }

  /** Go on with a square or begin the next; return whether there is any. */
  takeJob() {
    if (this.job && this.job.revision === this.job.tile.revision) return true;
    this.job = null;
    const { submaps } = this.tiles;
    for (let tile = this.tiles.next(); tile && !this.job && !submaps.isFull; tile = this.tiles.next()) {
      this.begin(tile);
    }
    return this.job !== null;
  }

  /** Begin a square, unless cells of it are still to be inflated. */
  begin(tile) {
    const [x, y] = originOf(tile);
    this.tiles.equip(tile);
    const { dirty: box, revision } = tile;
    const left = this.tiles.submapsWithin([x + box[0], y + box[1], x + box[2], y + box[3]]);
    const isWaiting = this.inflate(left).length > 0;
    tile.awaited = isWaiting ? left.map(([submap]) => submap) : [];
    if (isWaiting) return;
    this.tiles.submaps.trim();
    this.job = { tile, left, box, revision };
    this.composer.clear([x, y], box);
  }

  /** Have submaps inflated; return those that are not yet. */
  inflate(found) {
    const { submaps } = this.tiles;
    const needed = found.map(([submap]) => submap);
    submaps.use(needed);
    const packed = needed.filter(({ spans }) => spans === null);
    for (const submap of packed) submaps.inflate(submap);
    return packed;
  }

  /** Add some submaps to the square that is being composed; return about how many cells. */
  addSubmaps(budget) {
    const { tile, left, box } = this.job;
    const [x, y] = originOf(tile);
    const now = [];
    let cells = LEAST_CELLS;
    while (left.length > 0 && cells < budget) {
      const [submap, pose, extent] = left.pop();
      if (submap.waiting) cells += (submap.rows * submap.cols) / 8;
      this.tiles.submaps.upload(submap);
      now.push([submap, pose]);
      const width = Math.min(extent[2], x + box[2]) - Math.max(extent[0], x + box[0]);
      const height = Math.min(extent[3], y + box[3]) - Math.max(extent[1], y + box[1]);
      cells += Math.max(0.6 * width * height, LEAST_CELLS);
    }
    this.composer.add(now);
    if (left.length === 0) this.finishJob();
    return cells;
  }

  finishJob() {
    const { gl } = this;
    const { tile } = this.job;
    this.composer.finish(tile.target);
    gl.bindTexture(gl.TEXTURE_2D, tile.texture);
    gl.generateMipmap(gl.TEXTURE_2D);
    tile.dirty = null;
    tile.stale = false;
    this.numComposed++;
    this.job = null;
  }

  /**
   * Return what the map is around a point, at most a square of it.
   * @param {[number, number]} middle [m, map]
   * @param {number} reach [m]
   * @returns {import("../wall_fit.js").Levels}
   */
  levelsAround(middle, reach) {
    const { gl, composer } = this;
    const { resolution } = composer;
    const half = Math.min(Math.ceil(reach / resolution), TILE / 2);
    const [left, bottom] = middle.map((at) => Math.floor(at / resolution) - half);
    const edge = 2 * half;
    this.job = null; // the sums are needed here; its square is still dirty
    composer.clear([left, bottom], [0, 0, edge, edge]);
    const found = this.tiles.submapsWithin([left, bottom, left + edge, bottom + edge]);
    const isPartial = this.inflate(found).length > 0;
    const submaps = found.filter(([{ spans }]) => spans !== null);
    for (const [submap] of submaps) this.tiles.submaps.upload(submap);
    composer.add(submaps);
    this.tiles.submaps.trim();
    composer.finish(this.scratchTarget);
    const pixels = new Uint8Array(4 * edge * edge);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.scratchTarget);
    gl.readPixels(0, 0, edge, edge, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return {
      resolution,
      isPartial,
      at: (x, y) => {
        const col = Math.floor(x / resolution) - left;
        const row = Math.floor(y / resolution) - bottom;
        const at = 4 * (row * edge + col);
        if (col < 0 || row < 0 || col >= edge || row >= edge || pixels[at + 3] === 0) return -1;
        return pixels[at + 2] / 255;
      },
    };
  }
}
