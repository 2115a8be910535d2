// SPDX-License-Identifier: Apache-2.0
/**
 * A worker that inflates submaps and patches, beside the page's own thread.
 *
 * It answers with what the graphics card needs: the cells with a rim of unknown ones, where any of
 * them are known, and a small preview. Cells of growing submaps it keeps, for patches.
 * @module
 */
import { BLOCK, MARGIN, SHRINK, strideOf } from "./cells.js";

/** How much floor and how much wall a cell is in previews, two bytes for each of its values. */
let shades = new Uint8Array(512);
/** @typedef {{rows: number, cols: number, bytes: Uint8Array}} Cells with their rim */
/** @type {Map<number, Cells & {version: number}>} */
const growing = new Map();
let work = Promise.resolve();

// Patches must be applied in their order. Previews come first and are small: all of them are inflated
// side by side, as most of the time of one is waiting.
onmessage = ({ data }) => {
  const done = data.isPreview ? takePreview(data) : work.then(() => take(data));
  work = Promise.all([work, done.catch((error) => {
    const { submap, generation, isPreview } = data;
    postMessage({ problem: String(error), submap, generation, isPreview });
  })]);
};

async function take(job) {
  if (job.shades) {
    shades = job.shades;
    growing.clear();
  } else if (job.base === undefined) {
    await takeSubmap(job);
  } else {
    await takePatch(job);
  }
}

async function takePreview({ packed, ...head }) {
  const { rows, cols } = head;
  const pixels = { rows, cols, bytes: new Uint8Array((rows + 2) * strideOf(cols)) };
  await inflateInto(pixels, packed, { row: 0, col: 0, rows, cols });
  const preview = new Uint8Array(4 * rows * cols);
  for (let row = 0, to = 0; row < rows; row++) {
    const from = (row + 1) * strideOf(cols) + MARGIN;
    for (let at = from; at < from + cols; at++, to += 4) {
      const pixel = pixels.bytes[at];
      preview[to] = 17 * (pixel & 15);
      preview[to + 1] = 17 * (pixel >> 4);
      preview[to + 2] = Math.min(255, preview[to] + preview[to + 1]);
    }
  }
  postMessage({ ...head, preview, dense: denseBox(preview, rows, cols) }, [preview.buffer]);
}

async function takeSubmap({ packed, ...head }) {
  const { rows, cols } = head;
  const cells = { rows, cols, bytes: new Uint8Array((rows + 2) * strideOf(cols)) };
  await inflateInto(cells, packed, { row: 0, col: 0, rows, cols });
  if (head.finished) growing.delete(head.submap);
  else growing.set(head.submap, { ...cells, version: head.version, bytes: cells.bytes.slice() });
  const spans = knownSpans(cells);
  const answer = { ...head, cells: cells.bytes, spans };
  const owned = [cells.bytes.buffer, spans.buffer];
  if (head.finished) { // of these, the server sends a preview; and their cells can be had again
    answer.packed = packed;
    owned.push(packed);
  } else {
    const box = { row: 0, col: 0, rows: Math.ceil(rows / SHRINK), cols: Math.ceil(cols / SHRINK) };
    answer.preview = shrunk(cells, box);
    answer.dense = denseBox(answer.preview, box.rows, box.cols);
    owned.push(answer.preview.buffer);
  }
  postMessage(answer, owned);
}

async function takePatch({ packed, ...patch }) {
  const cells = growing.get(patch.submap);
  if (cells?.version !== patch.base) {
    postMessage({ ...patch, ignored: true });
    return;
  }
  await inflateInto(cells, packed, patch);
  cells.version = patch.version;
  const row = Math.floor(patch.row / SHRINK);
  const col = Math.floor(patch.col / SHRINK);
  const previewBox = {
    row, col, rows: Math.ceil((patch.row + patch.rows) / SHRINK) - row,
    cols: Math.ceil((patch.col + patch.cols) / SHRINK) - col,
  };
  const preview = shrunk(cells, previewBox);
  const spans = knownSpans(cells);
  const part = cutOut(cells, patch);
  postMessage({ ...patch, cells: part, spans, preview, previewBox },
    [part.buffer, spans.buffer, preview.buffer]);
}

/**
 * Inflate a zlib stream into a box of cells, row by row as it comes.
 * @param {Cells} cells
 * @param {ArrayBuffer} packed
 * @param {{row: number, col: number, rows: number, cols: number}} box
 */
async function inflateInto(cells, packed, box) {
  if (box.rows * box.cols === 0) return;
  const stride = strideOf(cells.cols);
  const { readable, writable } = new DecompressionStream("deflate");
  const writer = writable.getWriter(); // not from a Blob, which takes a detour through another process
  const written = Promise.all([writer.write(packed), writer.close()]);
  written.catch(() => {}); // the reader of the stream gets the error
  const reader = readable.getReader();
  let row = 0;
  let col = 0;
  for (let { done, value } = await reader.read(); !done; { done, value } = await reader.read()) {
    for (let at = 0; at < value.length;) {
      if (row >= box.rows) throw new RangeError("a submap has more cells than it says");
      const count = Math.min(box.cols - col, value.length - at);
      const to = (box.row + row + 1) * stride + MARGIN + box.col + col;
      cells.bytes.set(value.subarray(at, at + count), to);
      at += count;
      col += count;
      if (col === box.cols) [row, col] = [row + 1, 0];
    }
  }
  if (row < box.rows) throw new RangeError("a submap has less cells than it says");
}

/** Pixels of a preview that are known as a whole: a stray ray is in a part of each. */
const DENSE = 160;

/**
 * Return the box around squares of pixels that are all known as a whole, null if there are none.
 * @param {Uint8Array} preview four bytes a pixel, the third says how much of it is known
 */
function denseBox(preview, rows, cols) {
  const isDense = (row, col) => preview[4 * (row * cols + col) + 2] >= DENSE;
  let [low, high, left, right] = [Infinity, -1, Infinity, -1];
  for (let row = 0; row + 1 < rows; row++) {
    for (let col = 0; col + 1 < cols; col++) {
      if (!isDense(row, col) || !isDense(row + 1, col + 1)) continue;
      if (!isDense(row, col + 1) || !isDense(row + 1, col)) continue;
      low = Math.min(low, row);
      high = row + 2;
      left = Math.min(left, col);
      right = Math.max(right, col + 2);
    }
  }
  return high < 0 ? null : { row: low, col: left, rows: high - low, cols: right - left };
}

function cutOut(cells, { row, col, rows, cols }) {
  const stride = strideOf(cells.cols);
  const found = new Uint8Array(rows * cols);
  for (let r = 0; r < rows; r++) {
    const from = (row + r + 1) * stride + MARGIN + col;
    found.set(cells.bytes.subarray(from, from + cols), r * cols);
  }
  return found;
}

/**
 * Return where cells are known: row, first and end column of runs of blocks.
 * @param {Cells} cells
 */
function knownSpans({ rows, cols, bytes }) {
  const words = new Uint32Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 4);
  const stride = strideOf(cols) / 4;
  const [down, across] = [Math.ceil(rows / BLOCK), Math.ceil(cols / BLOCK)];
  const found = [];
  for (let row = 0; row < down; row++) {
    let begin = -1;
    for (let col = 0; col <= across; col++) {
      const known = col < across && isBlockKnown(words, stride, row, col, rows);
      if (known && begin < 0) begin = col;
      if (!known && begin >= 0) {
        found.push(row, begin, col);
        begin = -1;
      }
    }
  }
  return new Uint16Array(found);
}

function isBlockKnown(words, stride, row, col, rows) {
  const endRow = Math.min(rows, (row + 1) * BLOCK);
  for (let r = row * BLOCK; r < endRow; r++) {
    const from = (r + 1) * stride + (MARGIN + col * BLOCK) / 4;
    const end = Math.min(from + BLOCK / 4, (r + 2) * stride);
    for (let at = from; at < end; at++) if (words[at] !== 0) return true;
  }
  return false;
}

/**
 * Return means over squares of cells, four bytes each: how much floor, how much wall, both
 * together, and zero.
 * @param {Cells} cells
 * @param {{row: number, col: number, rows: number, cols: number}} box of squares
 */
function shrunk({ rows, cols, bytes }, box) {
  const words = new Uint32Array(bytes.buffer, bytes.byteOffset, bytes.byteLength / 4);
  const stride = strideOf(cols) / 4;
  const found = new Uint8Array(4 * box.rows * box.cols);
  const count = SHRINK * SHRINK;
  for (let r = 0; r < box.rows; r++) {
    const beginRow = (box.row + r) * SHRINK;
    const endRow = Math.min(rows, beginRow + SHRINK);
    for (let c = 0; c < box.cols; c++) {
      let [floor, wall] = [0, 0];
      for (let row = beginRow; row < endRow; row++) {
        let word = words[(row + 1) * stride + MARGIN / 4 + box.col + c];
        for (; word !== 0; word >>>= 8) {
          const cell = word & 255;
          if (cell === 0) continue;
          floor += shades[2 * cell];
          wall += shades[2 * cell + 1];
        }
      }
      const to = 4 * (r * box.cols + c);
      found[to] = floor / count;
      found[to + 1] = wall / count;
      found[to + 2] = Math.min(255, found[to] + found[to + 1]);
    }
  }
  return found;
}
