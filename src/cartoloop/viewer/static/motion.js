// SPDX-License-Identifier: Apache-2.0
/**
 * Poses as they are shown: after an adjustment they glide to where they now belong.
 * @module
 */
import { wrapAngle } from "./poses.js";

const GLIDE_MS = 420;
/** Poses that move by less jump: nobody would see them glide [px, rad]. */
const SEEN_PX = 1.5;
const SEEN_RAD = 0.002;

/** A table of poses that glides. */
class Glide {
  constructor() {
    this.shown = new Float64Array(0);
    this.from = null;
  }

  /** Return whether any pose is further than that from where it is shown [m]. */
  differs(target, seen) {
    const count = Math.min(this.shown.length, target.length);
    for (let i = 0; i < count; i += 3) {
      if (Math.hypot(target[i] - this.shown[i], target[i + 1] - this.shown[i + 1]) > seen
        || Math.abs(wrapAngle(target[i + 2] - this.shown[i + 2])) > SEEN_RAD) return true;
    }
    return false;
  }

  begin() {
    this.from = this.shown.slice();
  }

  /** Show poses on their way to the target; 1 is there. */
  show(target, share) {
    const known = this.from && share < 1 ? Math.min(this.from.length, target.length) : 0;
    const shown = Float64Array.from(target);
    for (let i = 0; i < known; i += 3) {
      shown[i] = this.from[i] + share * (target[i] - this.from[i]);
      shown[i + 1] = this.from[i + 1] + share * (target[i + 1] - this.from[i + 1]);
      shown[i + 2] = this.from[i + 2] + share * wrapAngle(target[i + 2] - this.from[i + 2]);
    }
    this.shown = shown;
  }
}

/** Submaps and nodes on their way. */
export class Motion {
  constructor() {
    this.submaps = new Glide();
    this.nodes = new Glide();
    this.began = -Infinity;
    this.isPending = false;
    this.known = -1;
    this.calm = matchMedia("(prefers-reduced-motion: reduce)");
    /** How often poses began to glide. */
    this.numGlides = 0;
    /** Rises whenever what is shown has moved. */
    this.version = 0;
  }

  /** Forget all. */
  clear() {
    this.submaps = new Glide();
    this.nodes = new Glide();
    this.began = -Infinity;
    this.known = -1;
  }

  get isGliding() {
    return this.began > -Infinity;
  }

  /** Older poses have changed: from the next frame on they glide. */
  note() {
    this.isPending = true;
  }

  /**
   * Bring what is shown up to date.
   * @param {import("./state.js").MapState} state
   * @param {number} now [ms]
   * @param {number} scale pixels a metre
   */
  update(state, now, scale) {
    if (!this.isPending && !this.isGliding && this.known === state.graphVersion) return;
    this.known = state.graphVersion;
    const { submaps, nodes } = state.shownPoses;
    if (this.isPending) {
      this.isPending = false;
      const seen = SEEN_PX / scale;
      const isSeen = this.submaps.differs(submaps, seen) || this.nodes.differs(nodes, seen);
      if (isSeen && !this.calm.matches) {
        this.submaps.begin();
        this.nodes.begin();
        this.began = now;
        this.numGlides++;
      }
    }
    const share = Math.min(Math.max((now - this.began) / GLIDE_MS, 0), 1);
    const eased = share * share * (3 - 2 * share);
    this.submaps.show(submaps, eased);
    this.nodes.show(nodes, eased);
    this.version++;
    if (share >= 1) this.began = -Infinity;
  }
}
