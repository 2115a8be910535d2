// SPDX-License-Identifier: Apache-2.0
/**
 * Loop closures that the map disagrees with, or that were rejected: those to look at first.
 * @module
 */
import { Kind } from "./protocol.js";
import { residualOf } from "./residual.js";

/** While the map grows, all closures are not judged more often than this [ms]. */
const PERIOD_MS = 1000;

/** Knows which closures are violated at the poses of the map. */
export class Suspects {
  /** @param {import("./state.js").MapState} state */
  constructor(state) {
    this.state = state;
    this.begin();
  }

  /** Forget all: a connection begins. */
  begin() {
    /** Rows of closures in the graph that are violated. @type {Set<number>} */
    this.violated = new Set();
    /** Number of closures that were rejected. */
    this.numRejected = 0;
    /** Rises with each change. */
    this.version = 0;
    this.known = -1;
    this.judgedAt = -Infinity;
  }

  /** Judge again if anything has changed, and it is time; return whether it was done. */
  update(now) {
    const { state } = this;
    if (this.known === state.graphVersion) return false;
    if (!state.isOver && now - this.judgedAt < PERIOD_MS) return false;
    this.known = state.graphVersion;
    this.judgedAt = now;
    const { constraints, submapPoses, nodes } = state;
    const kinds = constraints.kinds.numbers;
    this.violated.clear();
    this.numRejected = 0;
    for (let row = 0; row < constraints.length; row++) {
      if (kinds[row] === Kind.REJECTED) this.numRejected++;
      if (kinds[row] !== Kind.CLOSURE || !state.knowsEnds(row)) continue;
      const { share } = residualOf(constraints.at(row), submapPoses.rows, nodes.rows);
      if (share > 1) this.violated.add(row);
    }
    this.version++;
    return true;
  }
}
