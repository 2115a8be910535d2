// SPDX-License-Identifier: Apache-2.0
/**
 * The messages of the server, decoded: docs/viewer-protocol.md is their reference.
 * Arrays are views into the buffer that was received; nothing is copied here.
 * @module
 */

/** The protocol that this page speaks. */
export const PROTOCOL_VERSION = 3;

/** @enum {number} */
export const Type = Object.freeze({
  HELLO: 1,
  SUBMAP: 2,
  SUBMAP_PATCH: 3,
  SUBMAP_POSES: 4,
  NODES: 5,
  NODE_TIMES: 6,
  CONSTRAINTS: 7,
  SCAN: 8,
  READINGS: 9,
  PLAYBACK: 10,
  LATEST_CLOSURE: 11,
  COMPLETE: 12,
  CLOSURE: 13,
  NODE_SCAN: 14,
  PICTURE: 15,
  PROBLEM: 16,
  PONG: 17,
  SUBMAP_PREVIEW: 18,
  ANSWER: 19,
  QUALITY: 20,
  FACTS: 21,
  CLOSURES: 22,
  BEFORE: 23,
  SESSIONS: 24,
  EDITS: 25,
  EDITED: 26,
  PATH: 27,
  STATES: 28,
  LOCALISATION: 29,
  GIVEN: 30,
});

/** Kinds of constraints. @enum {number} */
export const Kind = Object.freeze({ INTRA: 0, CLOSURE: 1, NODES: 2, REJECTED: 3 });

/**
 * @typedef {object} TableRows rows of a table that replace those from `first` on
 * @property {number} first
 * @property {number} count
 * @property {number} total rows of the table after that
 * @property {number} revision differs from the one before where older rows have changed
 */

/**
 * @typedef {object} Scan
 * @property {number} time stamp [s]
 * @property {[number, number, number]} pose tf_map_tracking [m, m, rad]
 * @property {number} number of the scan, or of the node
 * @property {Float32Array} points x, y, x, y, ... [m], tracking frame
 */

/**
 * @typedef {object} SubmapHead a submap's message without its cells
 * @property {number} submap
 * @property {number} version
 * @property {boolean} finished
 * @property {number} rows
 * @property {number} cols
 * @property {number} x centre of cell (0, 0) [m, submap frame]
 * @property {number} y
 * @property {number} resolution edge of a cell [m]
 */

const HEADER_BYTES = 8;
const text = new TextDecoder();

/**
 * Yield what one WebSocket message holds, as `{type, ...content}`; unknown types are skipped.
 * @param {ArrayBuffer} buffer
 * @returns {Generator<{type: number, [key: string]: any}>}
 * @throws {RangeError} where the buffer ends within a message
 */
export function* decode(buffer) {
  const view = new DataView(buffer);
  for (let start = 0; start < buffer.byteLength;) {
    const length = view.getUint32(start, true);
    const type = view.getUint16(start + 4, true);
    const at = start + HEADER_BYTES;
    if (at + length > buffer.byteLength) throw new RangeError("a message is cut off");
    const read = READERS[type];
    if (read) yield { type, ...read(buffer, at, length) };
    start = at + Math.ceil(length / 8) * 8;
  }
}

const READERS = {
  [Type.SUBMAP]: readSubmap,
  [Type.SUBMAP_PATCH]: readPatch,
  [Type.SUBMAP_PREVIEW]: readPreview,
  [Type.SUBMAP_POSES]: (buffer, at) => {
    const rows = readRows(buffer, at);
    return { ...rows, poses: new Float64Array(buffer, at + 16, 3 * rows.count) };
  },
  [Type.NODES]: (buffer, at) => {
    const rows = readRows(buffer, at);
    return { ...rows, poses: new Float64Array(buffer, at + 16, 3 * rows.count) };
  },
  [Type.PATH]: (buffer, at) => {
    const rows = readRows(buffer, at);
    return { ...rows, points: new Float64Array(buffer, at + 16, 3 * rows.count) };
  },
  [Type.NODE_TIMES]: (buffer, at) => {
    const rows = readRows(buffer, at);
    return { ...rows, times: new Float64Array(buffer, at + 16, rows.count) };
  },
  [Type.CONSTRAINTS]: readConstraints,
  [Type.SCAN]: readScan,
  [Type.NODE_SCAN]: readScan,
  [Type.BEFORE]: readBefore,
  [Type.PICTURE]: (buffer, at, length) => ({ png: new Uint8Array(buffer, at, length) }),
};
for (const type of [Type.HELLO, Type.READINGS, Type.PLAYBACK, Type.LATEST_CLOSURE, Type.COMPLETE,
  Type.CLOSURE, Type.PROBLEM, Type.PONG, Type.ANSWER, Type.QUALITY, Type.FACTS,
  Type.CLOSURES, Type.SESSIONS, Type.EDITS, Type.EDITED, Type.STATES,
  Type.LOCALISATION, Type.GIVEN]) {
  READERS[type] = (buffer, at, length) => ({
    content: JSON.parse(text.decode(new Uint8Array(buffer, at, length))),
  });
}

function readSubmap(buffer, at, length) {
  const [submap, version, flags, rows, cols] = new Uint32Array(buffer, at, 6);
  const [x, y, resolution] = new Float64Array(buffer, at + 24, 3);
  const packed = buffer.slice(at + 48, at + length);
  return { submap, version, finished: (flags & 1) === 1, rows, cols, x, y, resolution, packed };
}

function readPreview(buffer, at, length) {
  const [submap, , rows, cols] = new Uint32Array(buffer, at, 4);
  const [x, y, resolution] = new Float64Array(buffer, at + 16, 3);
  return { submap, rows, cols, x, y, resolution, packed: buffer.slice(at + 40, at + length) };
}

function readPatch(buffer, at, length) {
  const [submap, base, version, row, col, rows, cols] = new Uint32Array(buffer, at, 8);
  return { submap, base, version, row, col, rows, cols, packed: buffer.slice(at + 32, at + length) };
}

/** @returns {TableRows} */
function readRows(buffer, at) {
  const [first, count, total, revision] = new Uint32Array(buffer, at, 4);
  return { first, count, total, revision };
}

function readConstraints(buffer, at) {
  const rows = readRows(buffer, at);
  const n = rows.count;
  const start = at + 16;
  return {
    ...rows,
    a: new Uint32Array(buffer, start, n),
    b: new Uint32Array(buffer, start + 4 * n, n),
    poses: new Float32Array(buffer, start + 8 * n, 3 * n),
    kinds: new Uint8Array(buffer, start + 20 * n, n),
  };
}

/** Poses are copied, since they are kept. */
function readBefore(buffer, at) {
  const [numSubmaps, numNodes] = new Uint32Array(buffer, at, 2);
  const end = at + 8 + 24 * numSubmaps;
  return {
    submaps: new Float64Array(buffer.slice(at + 8, end)),
    nodes: new Float64Array(buffer.slice(end, end + 24 * numNodes)),
  };
}

/** @returns {Scan} */
function readScan(buffer, at) {
  const [time, x, y, theta] = new Float64Array(buffer, at, 4);
  const [number, count] = new Uint32Array(buffer, at + 32, 2);
  return { time, pose: [x, y, theta], number, points: new Float32Array(buffer, at + 40, 2 * count) };
}
