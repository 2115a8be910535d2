// SPDX-License-Identifier: Apache-2.0
/**
 * What the page knows of the map, beside the cells: tables, readings, the robot.
 * @module
 */
import { Kind, Type } from "./protocol.js";

/** Rows of numbers that grow. */
export class Table {
  /**
   * @param {Float32ArrayConstructor | Float64ArrayConstructor | Uint32ArrayConstructor |
   *   Uint8ArrayConstructor} Kind of the numbers
   * @param {number} width numbers a row
   */
  constructor(Kind, width = 1) {
    this.width = width;
    this.numbers = new Kind(64 * width);
    this.length = 0;
  }

  /** The rows, one after the other. */
  get rows() {
    return this.numbers.subarray(0, this.length * this.width);
  }

  /** Replace the rows from `first` on. */
  set(first, numbers) {
    const end = first * this.width + numbers.length;
    if (end > this.numbers.length) {
      const larger = new this.numbers.constructor(2 * end);
      larger.set(this.rows);
      this.numbers = larger;
    }
    this.numbers.set(numbers, first * this.width);
    this.length = end / this.width;
  }
}

/**
 * @typedef {object} Constraint
 * @property {number} row
 * @property {number} a submap, or node where the kind says so
 * @property {number} b node
 * @property {import("./poses.js").Pose} pose tf_a_b as measured
 * @property {number} kind
 */

/** The constraints. */
export class Constraints {
  constructor() {
    this.a = new Table(Uint32Array);
    this.b = new Table(Uint32Array);
    this.poses = new Table(Float32Array, 3);
    this.kinds = new Table(Uint8Array);
  }

  get length() {
    return this.kinds.length;
  }

  set(first, message) {
    for (const name of ["a", "b", "poses", "kinds"]) {
      this[name].set(first, message[name]);
    }
  }

  /** @returns {Constraint} */
  at(row) {
    const poses = this.poses.numbers;
    return {
      row, a: this.a.numbers[row], b: this.b.numbers[row],
      pose: [poses[3 * row], poses[3 * row + 1], poses[3 * row + 2]],
      kind: this.kinds.numbers[row],
    };
  }
}

/** The state; each part of it is null or empty until it was received. */
export class MapState {
  constructor() {
    this.begin();
  }

  /** Forget all: a connection begins. */
  begin() {
    this.hello = null;
    this.readings = null;
    this.playback = null;
    /** @type {import("./protocol.js").Scan | null} */
    this.scan = null;
    this.latestClosure = null;
    /** Verdict on the finished map, and its places. */
    this.quality = null;
    /** Facts of a map that grows no more. */
    this.facts = null;
    /** Drives that the map is made of. @type {import("./sessions.js").Session[]} */
    this.sessions = [];
    /** Edits of the map, and whether this page may edit. */
    this.edits = null;
    /** Poses before loop closure, once they were asked for; and whether they are shown. */
    this.before = null;
    this.isBefore = false;
    this.isComplete = false;
    /** Where the robot is in a finished map. @type {import("./localisation.js").LocalisationContent | null} */
    this.localisation = null;
    /** Stamp at which each state began [s], and its name. @type {[number, string][]} */
    this.states = [];
    /** x, y, and 1 where a stretch of the path begins. */
    this.path = new Table(Float64Array, 3);
    /** Rises with each change of the path. */
    this.pathVersion = 0;
    this.submapPoses = new Table(Float64Array, 3);
    this.nodes = new Table(Float64Array, 3);
    this.times = new Table(Float64Array);
    this.constraints = new Constraints();
    /** First node of each submap. @type {Map<number, number>} */
    this.firstNodes = new Map();
    this.revisions = {};
    /** Rises with each change of the graph or its poses. */
    this.graphVersion = 0;
  }

  /**
   * Take in a message; return whether older poses have changed by it.
   * @param {{type: number, [key: string]: any}} message
   */
  take(message) {
    switch (message.type) {
      case Type.HELLO: this.hello = message.content; break;
      case Type.READINGS: this.readings = message.content; break;
      case Type.PLAYBACK: this.playback = message.content; break;
      case Type.LATEST_CLOSURE: this.latestClosure = message.content; break;
      case Type.QUALITY: this.quality = message.content; break;
      case Type.FACTS: this.facts = message.content; break;
      case Type.SESSIONS: this.sessions = message.content.sessions; break;
      case Type.EDITS: this.edits = message.content; break;
      case Type.STATES: this.states = message.content.runs; break;
      case Type.LOCALISATION: this.localisation = message.content; break;
      case Type.PATH:
        this.path.set(message.first, message.points);
        this.pathVersion++;
        break;
      case Type.SCAN: this.scan = message; break;
      case Type.COMPLETE: this.isComplete = true; break;
      case Type.SUBMAP_POSES: return this.setRows("submapPoses", message, message.poses);
      case Type.NODES: return this.setRows("nodes", message, message.poses);
      case Type.NODE_TIMES: return this.setRows("times", message, message.times);
      case Type.CONSTRAINTS: return this.setRows("constraints", message, message);
      default:
    }
    return false;
  }

  /** Whether the map grows no more. */
  get isOver() {
    return ["finished", "stopped", "failed"].includes(this.readings?.state);
  }

  /** Poses of submaps and nodes that are to be shown. */
  get shownPoses() {
    if (this.isBefore && this.before) return this.before;
    return { submaps: this.submapPoses.rows, nodes: this.nodes.rows };
  }

  /** Show the poses before loop closure, or those of the map. */
  showBefore(isBefore) {
    this.isBefore = isBefore;
    this.graphVersion++;
  }

  /** Whether both ends of a constraint are known. */
  knowsEnds(row) {
    const { a, b, kinds } = this.constraints;
    const begins = kinds.numbers[row] === Kind.NODES ? this.nodes : this.submapPoses;
    return a.numbers[row] < begins.length && b.numbers[row] < this.nodes.length;
  }

  setRows(name, { type, first, revision }, rows) {
    const isNew = this.revisions[type] !== undefined && this.revisions[type] !== revision;
    this.revisions[type] = revision;
    this[name].set(first, rows);
    if (name === "constraints") this.noteFirstNodes(first);
    this.graphVersion++;
    return isNew && name !== "constraints";
  }

  noteFirstNodes(first) {
    if (first === 0) this.firstNodes.clear();
    const { a, b, kinds } = this.constraints;
    for (let row = first; row < kinds.length; row++) {
      if (kinds.numbers[row] !== Kind.INTRA) continue;
      const submap = a.numbers[row];
      const node = b.numbers[row];
      if (!(this.firstNodes.get(submap) <= node)) this.firstNodes.set(submap, node);
    }
  }
}
