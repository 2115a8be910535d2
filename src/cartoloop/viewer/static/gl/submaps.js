// SPDX-License-Identifier: Apache-2.0
/**
 * Submaps: inflated by workers and uploaded to the graphics card, if they are looked at closely.
 * @module
 */
import { MARGIN, SHRINK, strideOf } from "../cells.js";
import { Type } from "../protocol.js";
import { shadesOfCells } from "../shades.js";
import { createTexture, mipLevels } from "./context.js";

const WORKERS = Math.min(4, Math.max(2, (navigator.hardwareConcurrency ?? 2) - 1));
/** Overlapping submaps agree, so a single one is shown as sure as this many of it. */
const AGREEING = 2;
/** Levels of the mipmap of a preview: making more takes longer than it is worth. */
const PREVIEW_LEVELS = 4;
/** Number of inflated cells that are held; those longest out of sight are packed again. */
const MAX_CELL_BYTES = 160e6;

/**
 * @typedef {object} Submap
 * @property {number} submap its number
 * @property {boolean} finished
 * @property {number} rows
 * @property {number} cols
 * @property {number} x centre of cell (0, 0) [m, submap frame]
 * @property {number} y
 * @property {number} resolution [m]
 * @property {ArrayBuffer | null} packed cells as they came; null where they may still change
 * @property {boolean} isInflating whether a worker is at it
 * @property {number} used when its cells were needed last, counted in uses
 * @property {Uint16Array | null} spans row, first and end column of the blocks that are known; null
 *   as long as the cells are not inflated
 * @property {Uint8Array | null} waiting cells with a rim, until they are uploaded
 * @property {WebGLTexture | null} cells with a rim; null until they are
 */

/**
 * @typedef {object} Preview of a submap
 * @property {WebGLTexture} texture how much floor, how much wall, both together
 * @property {number} rows
 * @property {number} cols
 * @property {number} x centre of pixel (0, 0) [m, submap frame]
 * @property {number} y
 * @property {number} resolution edge of a pixel [m]
 * @property {Box | null} dense the part of it that is known as a whole, without rays that stray
 *   through windows; null if there is none
 * @property {boolean} isOwn whether the page has made it of the cells, as the submap grows
 */

/** @typedef {{row: number, col: number, rows: number, cols: number}} Box of cells */

/** All submaps that are known. */
export class Submaps {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {(submap: Submap | null, box?: Box) => void} onChange a submap is new (no box),
   *   or part of it has changed, or only a preview has (no submap)
   */
  constructor(gl, onChange) {
    this.gl = gl;
    this.onChange = onChange;
    /** @type {Map<number, Submap>} */
    this.all = new Map();
    /** @type {Map<number, Preview>} */
    this.previews = new Map();
    /** Submaps and patches that workers have still to do. */
    this.numPending = 0;
    /** Of these, previews of finished submaps. */
    this.numPreviewsPending = 0;
    this.generation = 0;
    /** Of submaps that can be packed again: bytes of inflated cells, and how many are being inflated. */
    this.cellBytes = 0;
    this.numInflating = 0;
    this.uses = 0;
    /** Which submaps squares wait for: their cells are not let go of. @type {() => Set<Submap>} */
    this.awaited = () => new Set();
    /** Submaps that came while they grew: their workers have cells of them. @type {Set<number>} */
    this.grown = new Set();
    this.maxEdge = gl.getParameter(gl.MAX_TEXTURE_SIZE) - 2 * MARGIN;
    /** Submaps that this device cannot draw, as they are too large for its textures. */
    this.tooLarge = new Set();
    this.workers = Array.from({ length: WORKERS }, () => {
      const worker = new Worker(new URL("../cells_worker.js", import.meta.url), { type: "module" });
      worker.onmessage = (event) => this.receive(event.data);
      return worker;
    });
  }

  /** Forget all: a connection begins. @param {{log_odds: number[]}} hello */
  begin(hello) {
    const { gl } = this;
    this.generation++;
    this.numPending = this.numPreviewsPending = this.numInflating = this.cellBytes = 0;
    this.grown.clear();
    for (const submap of this.all.values()) gl.deleteTexture(submap.cells);
    for (const preview of this.previews.values()) gl.deleteTexture(preview.texture);
    this.all.clear();
    this.previews.clear();
    this.tooLarge.clear();
    const shades = shadesOfCells(hello, AGREEING);
    for (const worker of this.workers) worker.postMessage({ shades });
  }

  /** Take in a SUBMAP, a SUBMAP_PATCH or a SUBMAP_PREVIEW. */
  take({ type, ...job }) {
    const isPreview = type === Type.SUBMAP_PREVIEW;
    if (type === Type.SUBMAP && job.finished && !this.grown.has(job.submap)) {
      this.keep(job);
      return;
    }
    if (type === Type.SUBMAP && !job.finished) this.grown.add(job.submap);
    this.give({ ...job, isPreview });
  }

  /** Keep a finished submap until its cells are to be seen: packed, it is a fifteenth of them. */
  keep(head) {
    if (this.isTooLarge(head)) return;
    const submap = { ...head, waiting: null, cells: null, spans: null, isInflating: false, used: 0 };
    this.all.set(head.submap, submap);
    this.onChange(submap);
  }

  /** Have the cells of a submap inflated, unless they are. @param {Submap} submap */
  inflate(submap) {
    const { submap: id, version, finished, rows, cols, x, y, resolution, packed } = submap;
    if (submap.isInflating || submap.spans !== null) return;
    Object.assign(submap, { packed: null, isInflating: true }); // it comes back with the cells
    this.numInflating++;
    this.give({ submap: id, version, finished, rows, cols, x, y, resolution, packed });
  }

  /** Whether no more should be inflated before something is packed again. */
  get isFull() {
    return this.numInflating > 0 && this.cellBytes > MAX_CELL_BYTES;
  }

  /** Note that the cells of these are needed now. @param {Submap[]} submaps */
  use(submaps) {
    this.uses++;
    for (const submap of submaps) submap.used = this.uses;
  }

  /** Let go of cells beyond the bound: of none that are needed now, first of the longest unused. */
  trim() {
    if (this.cellBytes <= MAX_CELL_BYTES) return;
    const awaited = this.awaited();
    const idle = [...this.all.values()]
      .filter((one) => one.packed && one.spans !== null && one.used < this.uses && !awaited.has(one))
      .sort((a, b) => b.used - a.used);
    while (this.cellBytes > MAX_CELL_BYTES && idle.length > 0) {
      const submap = idle.pop();
      this.gl.deleteTexture(submap.cells);
      this.cellBytes -= bytesOf(submap);
      Object.assign(submap, { cells: null, waiting: null, spans: null });
    }
  }

  /** Give a worker something to do. */
  give(job) {
    this.numPending++;
    if (job.isPreview) this.numPreviewsPending++;
    const worker = this.workers[job.submap % this.workers.length];
    worker.postMessage({ ...job, generation: this.generation }, [job.packed]);
  }

  receive(done) {
    if (done.generation !== this.generation) return;
    this.numPending--;
    if (done.isPreview) this.numPreviewsPending--;
    if (done.problem || done.ignored) {
      const submap = this.all.get(done.submap);
      if (submap?.isInflating) {
        this.numInflating--; // damaged: it shows nothing
        Object.assign(submap, { isInflating: false, spans: new Uint16Array(0) });
      }
      this.onChange(null);
    } else if (done.isPreview) {
      this.takePreview(done, false);
    } else if (done.base === undefined) {
      this.takeWhole(done);
    } else {
      this.takePatch(done);
    }
  }

  isTooLarge({ submap, rows, cols }) {
    const isSo = Math.max(rows, cols) > this.maxEdge;
    if (isSo) this.tooLarge.add(submap);
    return isSo;
  }

  takePreview({ submap, preview, rows, cols, x, y, resolution, dense }, isOwn) {
    const { gl } = this;
    // That of the finished submap may overtake what a worker makes of it as it was before.
    if (isOwn && this.previews.get(submap)?.isOwn === false) return;
    gl.deleteTexture(this.previews.get(submap)?.texture ?? null);
    this.previews.delete(submap);
    if (rows * cols === 0 || Math.max(rows, cols) > this.maxEdge) return;
    const texture = createTexture(gl, gl.RGBA8, cols, rows, {
      levels: Math.min(mipLevels(cols, rows), PREVIEW_LEVELS), min: gl.LINEAR_MIPMAP_NEAREST, mag: gl.LINEAR,
    });
    this.previews.set(submap, { texture, rows, cols, x, y, resolution, isOwn, dense });
    this.fillPreview(texture, preview, { row: 0, col: 0, rows, cols });
    this.onChange(null);
  }

  /** The preview of a submap that grows, which the page makes itself. */
  takeOwnPreview({ submap, rows, cols, x, y, resolution, preview, dense }) {
    const shift = ((SHRINK - 1) / 2) * resolution;
    this.takePreview({
      submap, preview, dense, rows: Math.ceil(rows / SHRINK), cols: Math.ceil(cols / SHRINK),
      x: x + shift, y: y + shift, resolution: SHRINK * resolution,
    }, true);
  }

  takeWhole({ cells, spans, preview, dense, ...head }) {
    const { gl } = this;
    if (this.isTooLarge(head)) return;
    const before = this.all.get(head.submap);
    if (head.finished) this.cellBytes += bytesOf(head);
    if (before?.isInflating) {
      this.numInflating--;
      this.onChange(Object.assign(before, { packed: head.packed, spans, waiting: cells, isInflating: false }));
      return;
    }
    const submap = { ...head, waiting: cells, cells: null, spans, isInflating: false, used: this.uses };
    if (preview) this.takeOwnPreview({ ...head, preview, dense });
    this.all.set(head.submap, submap);
    this.upload(submap);
    gl.deleteTexture(before?.cells ?? null);
    this.trim();
    this.onChange(submap);
  }

  takePatch({ cells, spans, preview, previewBox, ...patch }) {
    const { gl } = this;
    const submap = this.all.get(patch.submap);
    if (!submap) return;
    this.upload(submap);
    gl.bindTexture(gl.TEXTURE_2D, submap.cells);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, patch.col + MARGIN, patch.row + 1, patch.cols, patch.rows,
      gl.RED_INTEGER, gl.UNSIGNED_BYTE, cells);
    const shown = this.previews.get(patch.submap);
    if (shown?.isOwn) this.fillPreview(shown.texture, preview, previewBox);
    submap.spans = spans;
    this.onChange(submap, patch);
  }

  /** Upload the cells of a submap, if that has not been done. @param {Submap} submap */
  upload(submap) {
    const { gl } = this;
    if (!submap.waiting) return;
    const [width, height] = [strideOf(submap.cols), submap.rows + 2];
    submap.cells = createTexture(gl, gl.R8UI, width, height);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RED_INTEGER, gl.UNSIGNED_BYTE,
      submap.waiting);
    submap.waiting = null;
  }

  fillPreview(texture, preview, box) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, box.col, box.row, box.cols, box.rows, gl.RGBA,
      gl.UNSIGNED_BYTE, preview);
    gl.generateMipmap(gl.TEXTURE_2D);
  }
}

/** Return how many bytes the cells of a submap are, with their rim. */
function bytesOf({ rows, cols }) {
  return (rows + 2) * strideOf(cols);
}
